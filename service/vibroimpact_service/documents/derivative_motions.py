"""Rates of what only motions have: initial states, loads that vary, and laws of damping."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Final

import numpy as np

from vibroimpact_schema import motions, systems
from vibroimpact_service.documents import loads
from vibroimpact_service.documents.grid_values import to_fundamental
from vibroimpact_service.documents.varying import Path
from vibroimpact_solvers import damping
from vibroimpact_solvers.derivatives import LoadRate, MatrixRate, Parameter
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.matrices import SymmetricMatrix
from vibroimpact_solvers.model import System
from vibroimpact_solvers.time_history import Harmonic

_POWERS: Final = {"acceleration": 0, "velocity": 1, "displacement": 2}
"""Powers of the frequency to which the load by a base is proportional."""


def with_start(parameter: Parameter, n: int, name: str, dof: int) -> Parameter:
    """Return a parameter with the rate of one initial displacement or velocity."""
    rate = np.zeros(n)
    rate[dof] = 1.0
    return replace(parameter, x=rate) if name == "x" else replace(parameter, v=rate)


def with_load(
    parameter: Parameter, term: Any, place: int, of: System, name: str
) -> Parameter | None:
    """Return a parameter with the rates of a load with its amplitude, frequency or phase."""
    if not isinstance(term, motions.HarmonicLoad | motions.HarmonicBase):
        return None
    rates = list[LoadRate]()
    unit = term.model_copy(update={"amplitude": 1.0}) if name == "amplitude" else term
    for made in loads.decoded(unit, place, of):
        assert isinstance(made, Harmonic)
        cosine = made.amplitude * math.cos(made.phase)
        sine = made.amplitude * math.sin(made.phase)
        match name:
            case "amplitude":
                rates.append(LoadRate(made.dof, made.frequency, cosine, sine))
            case "phase":
                rates.append(LoadRate(made.dof, made.frequency, -sine, cosine))
            case "frequency":
                power = 0.0
                if isinstance(term, motions.HarmonicBase):
                    power = _POWERS[term.base] / made.frequency
                rates.append(
                    LoadRate(made.dof, made.frequency, power * cosine, power * sine, -sine, cosine)
                )
            case _:
                return None
    return replace(parameter, loads=tuple(rates))


def with_damping(parameter: Parameter, document: Any, of: System, rest: Path) -> Parameter | None:
    """Return a parameter with the rate of C with a number of the law of damping."""
    match document, rest:
        case systems.RatioDamping(ratio=list() as each), ("ratio", int(mode)):
            ratios = np.eye(len(each))[mode]
            entries = damping.Ratio(tuple(ratios.tolist())).matrix(of)
        case systems.RatioDamping(), ("ratio",):
            entries = damping.Ratio((1.0,)).matrix(of)
        case systems.StructuralDamping(), ("structural",):
            entries = _times(1.0 / (document.at * to_fundamental(document.unit, of.units)), of.K)
        case systems.RayleighDamping(rayleigh=list()), ("rayleigh", int(which)):
            entries = (of.M, of.K)[which]
        case systems.RayleighDamping(rayleigh=systems.RayleighRatios() as given), (
            "rayleigh", "ratios", int(which),
        ):  # fmt: skip
            alpha, beta = _by_ratio(given, of, which)
            entries = _times(alpha, of.M).plus(beta, of.K)
        case _:
            return None
    return replace(parameter, C=MatrixRate(entries=entries))


def with_law(parameter: Parameter, document: systems.AnySystem, of: System) -> Parameter:
    """Return a parameter with the rate of C, where a law makes C of the matrices that change."""
    law = document.damping
    if law is None or not parameter.structural:
        return parameter
    change: SymmetricMatrix | None = None
    if isinstance(law, systems.RatioDamping):
        if parameter.M.entries is not None or parameter.K.entries is not None:
            message = (
                "damping ratios are those of modes that change with it: there is no derivative; "
                "give a matrix C or Rayleigh damping"
            )
            raise ModelError((), message, code="no_derivative")
        given = law.ratio if isinstance(law.ratio, list) else [law.ratio]
        # C is M to the power 3/2 of lengths and frequencies: of both factors, the root.
        half = 0.5 * (parameter.M.factor + parameter.K.factor)
        change = _times(half, damping.Ratio(tuple(given)).matrix(of))
    else:
        alpha, beta = _coefficients(law, of)
        change = _times(alpha, parameter.M.whole(of.M)).plus(beta, parameter.K.whole(of.K))
    before = parameter.C.entries
    entries = change if before is None else change.plus(1.0, before)
    return replace(parameter, C=replace(parameter.C, entries=entries))


def _coefficients(law: Any, of: System) -> tuple[float, float]:
    """Return alpha and beta of a law that is proportional to M and K."""
    if isinstance(law, systems.StructuralDamping):
        return 0.0, law.structural / (law.at * to_fundamental(law.unit, of.units))
    if isinstance(law.rayleigh, list):
        alpha, beta = law.rayleigh
        return alpha, beta
    ratios = law.rayleigh.ratios
    parts = [_by_ratio(law.rayleigh, of, which) for which in range(2)]
    alpha, beta = np.array(ratios) @ np.array(parts)
    return float(alpha), float(beta)


def _by_ratio(given: systems.RayleighRatios, of: System, which: int) -> tuple[float, float]:
    """Return alpha and beta by a unit of one of the two ratios."""
    low, high = (at * to_fundamental(given.unit, of.units) for at in given.at)
    scale = 2.0 / (high - low) / (high + low)
    return (scale * low * high * high, -scale * low) if which == 0 else (
        -scale * low * high * low, scale * high,
    )  # fmt: skip


def _times(factor: float, matrix: SymmetricMatrix) -> SymmetricMatrix:
    return replace(matrix, data=factor * matrix.data)
