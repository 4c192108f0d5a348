"""Requests that need kernels which no example in the contract needs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

_OSCILLATOR: Final = {"preset": "oscillator", "Omega0": 1, "constraints": [{"dof": 0, "gap": 1}]}
_DAMPED: Final = {**_OSCILLATOR, "zeta": 0.01}
_LOSSY: Final = {**_OSCILLATOR, "constraints": [{"dof": 0, "gap": 1, "restitution": 0.95}]}
_TWO_MASSES: Final = {**_DAMPED, "preset": "two_mass", "coupling": 1}
_CHAIN: Final = {"preset": "chain", "n": 13, "constraints": [{"dof": 5, "gap": 0.2}]}
_STOP: Final = {"type": "linear", "stiffness": 4, "damping": 0.5}
_TIMES: Final = {"start": 0, "stop": 2, "num": 5}

LIBRARY_ONLY: Final = frozenset({"whole_soft_motion.whole_soft_motion"})
"""Kernels that no request needs: of soft limiters without estimate of errors."""

PROBLEMS: Final[Mapping[str, Sequence[Mapping[str, Any]]]] = {
    "impact-modes": (
        {
            "system": _CHAIN,
            "frequency": {"values": [1.0, 2.5]},
            "tau": [0, 0.5],
            "outputs": [
                "impulse", "exists", "shape", "waveform", "energy", "stability", "harmonics"
            ],
        },
    ),
    "periodic-motions": (
        {
            "system": _CHAIN,
            "load": [{"dof": 0, "amplitude": 1}, {"dof": 0, "amplitude": 0.5, "harmonic": 2}],
            "frequency": {"values": [0.7]},
            "outputs": ["stability"],
        },
        # Harmonics of the load that move the limited coordinate: all roots of their sum.
        {
            "system": {**_DAMPED, "constraints": [{"dof": 0, "gap": 0.2, "restitution": 0.8}]},
            "load": [{"dof": 0, "amplitude": 1}, {"dof": 0, "amplitude": 0.5, "harmonic": 2}],
            "frequency": {"values": [0.7]},
        },
        # A mode that is much faster than the load.
        {
            "system": {
                "M": {"scalar": 1, "n": 2},
                "K": [[1e10, -1e10], [-1e10, 1.0000000001e10]],
                "constraints": [{"dof": 0, "gap": 0.2, "restitution": 0.8}],
            },
            "load": [{"dof": 0, "amplitude": 1}],
            "frequency": {"values": [0.5]},
            "outputs": ["extremes", "energy"],
        },
        # A stop with a stiffness.
        {
            "system": {
                **_DAMPED,
                "constraints": [{"dof": 0, "gap": 0.2, "law": _STOP}],
            },
            "load": [{"dof": 0, "amplitude": 1}],
            "frequency": {"values": [0.7]},
        },
    ),
    "attractors": (
        # Masses that rest at their walls.
        {
            "system": {
                "M": {"scalar": 1, "n": 2},
                "K": [[2, -1], [-1, 2]],
                "C": [[0.2, -0.1], [-0.1, 0.3]],
                "constraints": [
                    {"dof": 0, "gap": {"lower": None, "upper": 0.05}, "restitution": 0},
                    {"dof": 1, "gap": {"lower": 0.1, "upper": 0.5}, "restitution": 0},
                ],
            },
            "initial": {"x": [[0, 0]], "v": [[0.2, 0]]},
            "load": [{"dof": 0, "amplitude": 0.6}],
            "frequency": {"values": [0.5]},
            "settle": 4,
            "observe": 8,
            "longest": 4,
        },
    ),
    "time-history": (
        # An impact of one mass while the other one rests at its wall.
        {
            "system": {
                "M": {"scalar": 1, "n": 2},
                "K": [[2, -1], [-1, 2]],
                "C": [[0.2, -0.1], [-0.1, 0.3]],
                "constraints": [
                    {"dof": 0, "gap": {"lower": None, "upper": 0.05}, "restitution": 0},
                    {"dof": 1, "gap": {"lower": 0.1, "upper": 0.5}, "restitution": 0},
                ],
            },
            "initial": {"x": [0, 0], "v": [0.2, 0]},
            "load": [
                {"dof": 0, "amplitude": 0.6, "frequency": 0.5},
                {"dof": 1, "amplitude": -0.5, "frequency": 0.35, "phase": 0.4},
            ],
            "t_end": 40,
            "outputs": ["impacts", "contacts"],
        },
        {
            "system": {
                **_OSCILLATOR,
                "constraints": [
                    {"dof": 0, "gap": 0.5, "law": {"type": "linear", "stiffness": 9, "damping": 1}}
                ],
            },
            "initial": {"x": [0], "v": [1]},
            "t_end": 4,
            "t": {"num": 3},
            "outputs": ["x", "contacts"],
        },
        {
            "system": _LOSSY,
            "initial": {"x": [0], "v": [2]},
            "t_end": 4,
            "derivatives": ["system.constraints.0.gap"],
        },
    ),
    "slow-flow": (
        {
            "system": _DAMPED,
            "model": "damped",
            "variant": "truncated",
            "initial": {"gamma": 0.2},
            "t": _TIMES,
        },
        {
            "system": _TWO_MASSES,
            "model": "two_oscillator",
            "variant": "exact",
            "initial": {"gamma": 0.2},
            "t": _TIMES,
        },
        {
            "system": _LOSSY,
            "model": "restitution",
            "variant": "printed",
            "initial": {"omega": 5},
            "t": _TIMES,
        },
    ),
}  # fmt: skip
