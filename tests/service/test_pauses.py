"""Requests with extreme numbers look at their signal often, in units of a fixed piece of work."""

from __future__ import annotations

from typing import Any

import pytest

from tests import hostile
from tests.effort import least

MOST = 0.1
"""Seconds of the usual processor between two looks; pieces of work are made to take a tenth."""


def stiff(zeta: float) -> dict[str, Any]:
    wall = {"dof": 0, "gap": {"lower": None, "upper": 0}, "restitution": 0.8}
    return {
        "system": {"preset": "oscillator", "Omega0": 1, "zeta": zeta, "constraints": [wall]},
        "load": [{"dof": 0, "amplitude": 1}],
        "frequency": {"values": [2.6]},
        "initial": {"x": [[-2], [0]], "v": [[1], [-3]]},
        "settle": 200,
        "observe": 100,
    }


def soft(gap: float, v: float) -> dict[str, Any]:
    constraints = [{"dof": 0, "gap": gap}]
    return {
        "system": {
            "preset": "two_mass", "Omega0": 1, "coupling": 1, "constraints": constraints,
        },
        "initial": {"x": [0, 0], "v": [3, v]},
        "t_end": 6,
        "t": {"num": 61},
        "limiter": {"law": "power", "exponent": 17, "stiffness": 1, "scale": 0.968},
        "tolerance": 1e-8,
    }  # fmt: skip


def chain(n: int, *gaps: float) -> dict[str, Any]:
    walls = [{"dof": place, "gap": gap, "restitution": 0.9} for place, gap in enumerate(gaps)]
    return {"preset": "chain", "n": n, "constraints": walls}


HOSTILE: dict[str, tuple[str, dict[str, Any]]] = {
    "damping of 1e6": ("attractors", stiff(1e6)),
    "damping of 1e9": ("attractors", stiff(1e9)),
    "soft limiters near": ("time-history", soft(1e-3, 0.0)),
    "soft limiters and a fast motion": ("time-history", soft(1.0, 1e12)),
    "digits of a large motion": (
        "time-history",
        {
            "system": chain(4, 0.2, 0.2), "initial": {"x": [0, 0, 5e10, 0], "v": [1, 0, 0, 1]},
            "t_end": 80, "t": [40, 80], "digits": 40, "tolerance": 1e-12, "outputs": ["x"],
        },
    ),
    "many points": (
        "sweep",
        {
            "kind": "impact-modes",
            "base": {"system": chain(13, 0.2), "frequency": {"start": 0.6, "stop": 2.4, "num": 40}},
            "axes": [
                {"path": "system.stiffness", "values": [0.8, 1.0, 1.2]},
                {"path": "system.constraints.0.gap", "start": 0.1, "stop": 300.0, "step": 0.05},
            ],
        },
    ),
    "bands of two constraints": (
        "existence-bands",
        {
            "system": chain(12, 0.2, 0.1), "frequency": {"start": 1.0, "stop": 3.0},
            "active": [0, 1],
        },
    ),
    "many harmonics": (
        "impact-modes",
        {
            "system": chain(3, 0.1), "frequency": {"values": [2.5e-9, 2.0], "unit": "Omega"},
            "dofs": [0, 1], "tau": [0, 0.5, 1], "outputs": ["impulse", "shape", "waveform"],
        },
    ),
}  # fmt: skip
"""Requests of which each looked at no signal for 0.1 s to minutes."""


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_requests_look_at_their_signal(name: str) -> None:
    kind, document = HOSTILE[name]
    hostile.longest_pause(kind, document)  # imports, and compiles
    looks = []

    def longest() -> float:
        meter = hostile.longest_pause(kind, document)
        looks.append(meter.looks)
        return meter.longest

    assert least(longest, MOST) < MOST
    assert min(looks) > 1
