"""Columns of the tables of impacts and contacts, which motions and ensembles of them share."""

from __future__ import annotations

from typing import Annotated

from vibroimpact_solvers.arrays import Floats, Integers, Quantity


def _impact(unit: str, name: str, column: str) -> Quantity:
    return Quantity(("impact",), unit, name, path=f"impacts/{column}")


def _contact(unit: str, name: str, column: str) -> Quantity:
    return Quantity(("contact",), unit, name, path=f"contacts/{column}")


ImpactTime = Annotated[Floats | None, _impact("time", "time of the impact", "time")]
ImpactConstraint = Annotated[Integers | None, _impact("1", "index of the constraint", "constraint")]
ImpactSide = Annotated[Integers | None, _impact("1", "wall: 1 the upper, -1 the lower one", "side")]
ImpactVelocity = Annotated[
    Floats | None,
    _impact("length time-1", "velocity of the coordinate before the impact", "velocity"),
]
ImpactImpulse = Annotated[
    Floats | None, _impact("mass length time-1", "impulse on the structure", "impulse")
]
ImpactCondition = Annotated[
    Floats | None,
    _impact("1", "error of the state relative to it, in units of the rounding 2^-52", "condition"),
]
ContactStart = Annotated[
    Floats | None, _contact("time", "time of the last impact listed before it", "start")
]
ContactRest = Annotated[
    Floats | None, _contact("time", "time at which the coordinate comes to rest", "rest")
]
ContactStop = Annotated[
    Floats | None, _contact("time", "time of release, or the end of the motion", "stop")
]
ContactConstraint = Annotated[
    Integers | None, _contact("1", "index of the constraint", "constraint")
]
ContactSide = Annotated[
    Integers | None, _contact("1", "wall: 1 the upper, -1 the lower one", "side")
]
ContactImpulse = Annotated[
    Floats | None,
    _contact("mass length time-1", "impulse of the wall on the structure, rest to stop", "impulse"),
]
