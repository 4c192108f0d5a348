"""Measured rates of the methods. Written by ``python -m benchmarks.prices --calibrate``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple


class Rate(NamedTuple):
    """Time of a method, or of a kind whatever its methods are.

    `start` seconds, and `each` seconds for an operation of its step.
    """

    start: float
    each: float


class Sweep(NamedTuple):
    """Time of a sweep: what it begins with, a point, and parts of what points take alone."""

    start: float
    point: float
    begun: float
    work: float


SWEEP: Final = Sweep(0.00013, 1.6e-05, 1.1, 0.94)
RATES: Final[Mapping[str, Rate]] = {
    "spectrum, diagonal": Rate(3e-05, 1e-09),
    "spectrum, closed form": Rate(5e-05, 1e-07),
    "spectrum, dense": Rate(0.0004, 6.4e-11),
    "spectrum, tridiagonal": Rate(0.0004, 5.5e-11),
    "spectrum, banded": Rate(0.0006, 1.9e-11),
    "spectrum, lowest modes": Rate(0.0038, 3.1e-10),
    "natural-frequencies": Rate(1.5e-06, 0),
    "natural-frequencies: response, residual flexibility": Rate(4.5e-05, 1.1e-09),
    "natural-frequencies: shape, rows of the modes": Rate(9.2e-06, 1.3e-09),
    "impact-modes": Rate(0.001, 0),
    "impact-modes: energy, modal sum": Rate(0.00015, 2.8e-10),
    "impact-modes: existence, certified": Rate(0.0001, 4.4e-11),
    "impact-modes: harmonics, modal sum": Rate(0.00025, 1.1e-09),
    "impact-modes: harmonics, modal sum, above the spectrum direct": Rate(0.00056, 4.5e-10),
    "impact-modes: impulse, direct": Rate(0.0001, 1e-09),
    "impact-modes: impulse, scalar": Rate(0.0001, 2.7e-10),
    "impact-modes: shape, modal sum": Rate(9.9e-05, 1.1e-09),
    "impact-modes: shape, modal sum, above the spectrum direct": Rate(5.6e-05, 1e-09),
    "impact-modes: stability, half-period map": Rate(0.00049, 3e-10),
    "impact-modes: stability, sum over the modes": Rate(0.0001, 1e-09),
    "impact-modes: waveform, modal sum": Rate(4e-05, 1.6e-10),
    "impact-modes: waveform, modal sum, above the spectrum direct": Rate(0.00011, 4.8e-10),
    "existence-bands": Rate(5.1e-05, 0),
    "existence-bands: bands, branch and bound": Rate(0.00015, 5.8e-10),
    "existence-bands: bands, search": Rate(0.13, 2.8e-09),
    "existence-bands: stability, half-period map": Rate(0.00015, 2.2e-09),
    "existence-bands: stability, sum over the modes": Rate(0.1, 2.2e-09),
    "resonances": Rate(0.0001, 0),
    "resonances: response, division": Rate(0.0037, 2.6e-09),
    "resonances: spectrum, constrained structure": Rate(0.00011, 1.6e-10),
    "periodic-motions": Rate(0.0038, 0),
    "periodic-motions: energy, quadrature": Rate(0.003, 2e-10),
    "periodic-motions: energy, quadrature of all phases": Rate(0.0001, 5.9e-11),
    "periodic-motions: existence, safe steps": Rate(0.0001, 5.4e-10),
    "periodic-motions: existence, safe steps of all phases": Rate(0.0001, 2.9e-10),
    "periodic-motions: impulse, closed form": Rate(0.0001, 8.2e-10),
    "periodic-motions: impulse, isolation of durations": Rate(0.05, 4.3e-10),
    "periodic-motions: impulse, newton": Rate(0.0001, 2.8e-09),
    "periodic-motions: stability, characteristic equation": Rate(0.0023, 4.8e-12),
    "periodic-motions: stability, monodromy": Rate(0.00011, 8.6e-11),
    "branches": Rate(0.57, 0),
    "branches: energy, quadrature": Rate(0.0001, 2.9e-10),
    "branches: energy, quadrature of all phases": Rate(0.0001, 5.9e-11),
    "branches: existence, safe steps of all phases": Rate(0.0001, 2.9e-10),
    "branches: impulse, continuation in switchings": Rate(0.0001, 1e-09),
    "branches: stability, monodromy": Rate(0.00011, 8.6e-11),
    "branches: existence, safe steps": Rate(0.0001, 3.5e-08),
    "branches: impulse, continuation": Rate(0.0001, 1e-09),
    "branches: stability, characteristic equation": Rate(0.0001, 5e-11),
    "attractors": Rate(0.014, 0),
    "attractors: free_motion, exact between impacts": Rate(0.0001, 2.4e-10),
    "attractors: history, modal sum": Rate(0.0001, 6.2e-11),
    "attractors: impulse, newton": Rate(0.0001, 7.1e-10),
    "attractors: response, recurrence": Rate(0.0001, 3.4e-10),
    "attractors: stability, saltation": Rate(0.0001, 2.1e-11),
    "time-history": Rate(0.0012, 0),
    "time-history: free_motion, Taylor series": Rate(9.5e-05, 1e-07),
    "time-history: free_motion, Taylor series between switchings of stops": Rate(0.0001, 2.2e-09),
    "time-history: free_motion, exact between impacts": Rate(0.00011, 1.3e-09),
    "time-history: free_motion, exact between switchings of stops": Rate(0.0001, 1e-09),
    "time-history: history, modal sum": Rate(0.00082, 2.2e-10),
    "ensemble": Rate(0.0032, 0),
    "ensemble: free_motion, Taylor series between switchings of stops": Rate(0.0001, 2.2e-09),
    "ensemble: free_motion, exact between impacts": Rate(0.0001, 2.3e-10),
    "ensemble: history, modal sum": Rate(0.0006, 8.7e-11),
    "slow-flow": Rate(0.00024, 0),
    "slow-flow: free_motion, exact between impacts": Rate(0.00019, 3.7e-10),
    "slow-flow: free_motion, parabolas": Rate(7.8e-05, 4.7e-10),
    "slow-flow: slow_flow, closed form": Rate(0.00039, 2.6e-10),
    "slow-flow: slow_flow, coordinate transformation": Rate(7.9e-05, 6.4e-10),
    "slow-flow: slow_flow, elementary": Rate(8.1e-05, 9.7e-10),
    "slow-flow: slow_flow, exact between impacts": Rate(0.0005, 1.1e-09),
    "slow-flow: slow_flow, integration": Rate(0.00011, 8e-10),
    "slow-flow: slow_flow, inverse tangent integral": Rate(0.00012, 1.6e-09),
    "slow-flow: slow_flow, parabolas": Rate(7.9e-05, 4.8e-11),
    "slow-flow: slow_flow, time transformation": Rate(9.9e-05, 3.4e-10),
}
