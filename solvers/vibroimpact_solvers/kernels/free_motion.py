"""What natural modes do between the impacts of an impact mode, and what their errors do.

See `stability.one_impact` for the equations.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.kernels.jit import fma, inner, kernel
from vibroimpact_solvers.kernels.phases import LARGEST, sine_cosine


class FreeMotion(NamedTuple):
    """Modes between two impacts, each (mode,)."""

    root: Floats  # natural frequencies, 0 of rigid-body modes
    root_low: Floats  # what rounding took from them
    root_error: Floats


class Phases(NamedTuple):
    """Free motion of unit duration, modes in any order: parts of `Modes`, each (mode,)."""

    phase_error: Floats
    pole: Floats
    sine: Floats
    reach: Floats
    reach_slope: Floats
    pull: Floats
    pull_slope: Floats
    bend: Floats
    bend_slope: Floats


class Modes(NamedTuple):
    """Modes that impacts of one constraint join, free for a unit of time, each (mode,).

    Functions of the phases are as exact as rounding; what errors of the phases do is to be told.
    """

    weight: Floats  # squares of the participations, of sum 1
    weight_error: Floats
    phase_error: Floats
    pole: Floats  # cosines of the phases less the known zero, by ascending size
    sine: Floats
    reach: Floats  # sines over phases; 1 of rigid-body modes
    reach_slope: Floats  # their derivatives by the phases
    pull: Floats  # sines times phases
    pull_slope: Floats
    bend: Floats  # phases times cotangents of half of them, or times minus their tangents
    bend_slope: Floats
    known: float  # the known zero, 1 or -1
    # Sum of weight times bend, and what rounding does to it: acceleration of the struck coordinate
    # over its velocity, before the impact
    curvature: float
    curvature_rounding: float


@kernel
def turn(free: FreeMotion, omega: float, omega_low: float, mirrored: bool, to: Phases) -> None:
    """Fill in what the modes do between impacts.

    Half phases are sums of two numbers: close to a pole or the known zero, distances from it are
    as exact as the natural frequencies are.

    Parameters
    ----------
    free : FreeMotion
    omega, omega_low : float
        Frequency of the triangle wave and what rounding took from it, rad per unit of time.
    mirrored : bool
        Whether a free motion lasts half a period and not a whole one.
    to : Phases
    """
    # Half its duration, and what rounding took from it.
    time = (1.0 if mirrored else 2.0) / omega
    time_low = time * (fma(-time, omega, 1.0 if mirrored else 2.0) - time * omega_low)
    time_low *= 0.5 if not mirrored else 1.0
    for j in range(free.root.size):
        root = free.root[j]
        half = root * time
        low = fma(free.root_low[j], time, fma(root, time_low, fma(root, time, -half)))
        phase = 2.0 * (half + low)
        to.phase_error[j] = 2.0 * free.root_error[j] * time + EPS * EPS * phase
        if not half < LARGEST:
            to.phase_error[j] = math.inf
            half, low = 1.0, 0.0
        sine, cosine = sine_cosine(half, low)
        near, far = (cosine, -sine) if mirrored else (sine, cosine)
        to.pole[j] = (2.0 if mirrored else -2.0) * near * near
        to.sine[j] = 2.0 * sine * cosine
        to.pull[j] = phase * to.sine[j]
        to.pull_slope[j] = to.sine[j] + phase * (1.0 - 2.0 * sine * sine)
        if phase == 0.0:
            to.reach[j], to.reach_slope[j] = 1.0, 0.0
            to.bend[j], to.bend_slope[j] = 0.0 if mirrored else 2.0, 0.0
            continue
        to.reach[j] = to.sine[j] / phase
        to.reach_slope[j] = ((1.0 - 2.0 * sine * sine) - to.reach[j]) / phase
        ratio = far / near
        to.bend[j] = phase * ratio
        to.bend_slope[j] = ratio - 0.5 * phase * (1.0 + ratio * ratio)


@inner
def _sum_others(modes: Modes, home: int, t: complex) -> tuple[complex, complex, complex]:
    """Return the sums G, E, D of `stability.one_impact` over all modes but one."""
    G, E, D = complex(0.0, 0.0), complex(0.0, 0.0), complex(0.0, 0.0)
    for j in range(modes.weight.size):
        if j != home:
            term = modes.weight[j] / ((modes.pole[home] - modes.pole[j]) + t)
            G += term
            E += modes.reach[j] * term
            D += modes.pull[j] * term
    return G, E, D


@inner
def _nearness(modes: Modes, j: int, steep: float) -> float:
    """Return by how much more than to first order an error of a phase acts: at a pole, infinitely.

    `steep` is the change with the phase of the distance from its pole, relative to the distance.
    """
    steep = max(steep, 1.0 / math.sqrt(2.0 * abs(modes.pole[j]) + 1e-300))
    near = steep * modes.phase_error[j]
    return 1.0 / (1.0 - near) if near < 1.0 else math.inf


@inner
def effect(modes: Modes, home: int, t: complex) -> float:
    """Return what errors of the modes do to ``t (1 + sum_j R_j/(L - c_j))``, to first order.

    It is ``t Q + w B + w^2 (L + c)``, with w and c of the mode at home, ``L = c + t``, the sums
    over all other modes, ``Q = (L^2 - 1) G^2 + E (D - g)`` and, with the numbers r and p of that
    mode, ``B = 2 (L^2 - 1) G + r (D - g) + p E``.
    """
    weight, c, sine = modes.weight[home], modes.known + modes.pole[home], modes.sine[home]
    reach, pull = modes.reach[home], modes.pull[home]
    G, E, D = _sum_others(modes, home, t)
    D = D - modes.curvature
    from_known = modes.pole[home] + t
    square = from_known * (from_known + 2.0 * modes.known)
    Q, B = square * G * G + E * D, 2.0 * square * G + reach * D + pull * E
    by_G = 2.0 * square * (t * G + weight)
    by_E, by_D = t * D + weight * pull, t * E + weight * reach  # by the curvature: -by_D
    by_phase = sine * Q + weight * (modes.reach_slope[home] * D + modes.pull_slope[home] * E)
    by_phase = by_phase - weight * (weight * sine + by_D * modes.bend_slope[home])
    by_weight = B + 2.0 * weight * (2.0 * c + t) - by_D * modes.bend[home]
    near = _nearness(modes, home, 0.0)
    effect = abs(by_phase) * modes.phase_error[home] * near
    effect += abs(by_weight) * modes.weight_error[home]
    effect += abs(by_D) * modes.curvature_rounding
    for j in range(modes.weight.size):
        if j == home:
            continue
        inverse = 1.0 / ((modes.pole[home] - modes.pole[j]) + t)
        by_weight = (by_G + by_E * modes.reach[j] + by_D * modes.pull[j]) * inverse
        slope = by_E * modes.reach_slope[j] + by_D * modes.pull_slope[j]
        slope = (slope - modes.sine[j] * by_weight) * inverse - by_D * modes.bend_slope[j]
        by_weight = by_weight - by_D * modes.bend[j]
        near = _nearness(modes, j, 2.0 * abs(modes.sine[j] * inverse))
        effect += modes.weight[j] * abs(slope) * modes.phase_error[j] * near
        effect += abs(by_weight) * modes.weight_error[j]
    return float(effect)
