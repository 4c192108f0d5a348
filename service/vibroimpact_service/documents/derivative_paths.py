"""Paths by which answers are differentiated, as rates of the structure, its stops and the rest."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np

from vibroimpact_schema import motions, systems
from vibroimpact_service.documents import derivative_motions as of_motions
from vibroimpact_service.documents import varying
from vibroimpact_service.documents.grid_values import to_fundamental
from vibroimpact_service.documents.varying import Path, Varying
from vibroimpact_solvers import sweep
from vibroimpact_solvers.derivatives import MatrixRate, Parameter, StopRate
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.matrices import SymmetricMatrix
from vibroimpact_solvers.model import System

_SCALE: Final = "scale"
"""What stands for a factor of a matrix at the end of a path."""


def parameters(request: Any, of: System) -> tuple[Parameter, ...]:
    """Return the parameters by which the answer to a request is differentiated.

    Raises
    ------
    ModelError
        With a pointer to the path that is wrong.
    """
    named = []
    for place, text in enumerate(request.derivatives or ()):
        try:
            parameter = _parameter(request, of, text)
            _check_base(request, parameter)
            named.append(of_motions.with_law(parameter, request.system, of))
        except ModelError as error:
            pointer = ("derivatives", place)
            raise ModelError(pointer, error.message, code=error.code) from None
    return tuple(named)


def _check_base(request: Any, parameter: Parameter) -> None:
    """Refuse changes of the masses that a base moves, whose load they are."""
    load = getattr(request, "load", None) or ()
    if parameter.M and any(isinstance(term, motions.HarmonicBase) for term in load):
        message = "the load of the base goes with the masses: there is no derivative by these"
        raise ModelError((), message, code="no_derivative")


def _parameter(request: Any, of: System, text: str) -> Parameter:
    """Return the parameter of a path."""
    match text.split("."):
        case ["frequency"] if hasattr(request, "frequency"):
            return Parameter(text, "time-1", frequency=1.0)
        case ["system", "M" | "K" | "C" as name, last] if last == _SCALE:
            if getattr(of, name) is None:
                message = "the structure has no damping matrix"
                raise ModelError((), message, code="unknown_path")
            if name == "C" and (request.system.damping or request.system.dashpots):
                message = (
                    "the damping is that of C and of a law or dashpots: there is no derivative by "
                    "a factor of C; vary the numbers of these"
                )
                raise ModelError((), message, code="no_derivative")
            return _with_matrix(Parameter(text), name, MatrixRate(factor=1.0))
    number = varying.number(request, text)
    unit, _ = sweep.meaning(number.path)
    parameter = Parameter(text, unit)
    rates = _rates(request, of, parameter, number)
    if rates is None:
        message = (
            f"there are no derivatives by {text}: it is no number of the matrices, the stops, the "
            "loads, the frequencies or the initial state"
        )
        raise ModelError((), message, code="no_derivative")
    return rates


def _rates(request: Any, of: System, parameter: Parameter, number: Varying) -> Parameter | None:
    """Return a parameter with its rates, None where there are none by that number."""
    match number.path:
        case ("system", "M" | "K" | "C" as name, *_):
            entries = _entries(request.system, of.n, number)
            return _with_matrix(parameter, str(name), MatrixRate(entries=entries))
        case ("system", "force", int(dof)):
            force = np.zeros(of.n)
            force[dof] = 1.0
            return replace(parameter, force=force)
        case ("system", "constraints", int(index), *rest):
            return _of_stop(request.system.constraints[index], parameter, index, tuple(rest))
        case ("system", "damping", *rest):
            return of_motions.with_damping(parameter, request.system.damping, of, tuple(rest))
        case ("system", "dashpots", int(index), *rest):
            return _of_dashpot(request.system.dashpots[index], of.n, parameter, tuple(rest))
        case ("system", str(name)) if isinstance(request.system, systems.Preset):
            rule = _PRESETS.get((request.system.preset, name))  # type: ignore[attr-defined]
            return None if rule is None else rule(parameter, request.system)
        case ("initial", "x" | "v" as name, int(dof)):
            return of_motions.with_start(parameter, of.n, str(name), dof)
        case ("load", int(place), str(name)):
            return of_motions.with_load(parameter, request.load[place], place, of, name)
        case ("frequency", "values", int(place)):
            Omega = np.zeros(len(request.frequency.values))
            Omega[place] = to_fundamental(request.frequency.unit, of.units)
            return replace(parameter, frequency=Omega)
    return None


def _with_matrix(parameter: Parameter, name: str, rate: MatrixRate) -> Parameter:
    match name:
        case "M":
            return replace(parameter, M=rate)
        case "K":
            return replace(parameter, K=rate)
        case _:
            return replace(parameter, C=rate)


def _entries(document: Any, n: int, number: Varying) -> SymmetricMatrix:
    """Return the rate of a matrix with one of its numbers, and with the equal one by symmetry."""
    matrix = getattr(document, str(number.path[1]))
    places = [number.path[2:]]
    if number.mirror is not None:
        places.append(number.mirror[2:])
    rows, columns = list[int](), list[int]()
    for place in places:
        for i, j in _places(matrix, n, place):
            rows.append(i)
            columns.append(j)
    return SymmetricMatrix.sparse((n, n), rows, columns, np.ones(len(rows)))


def _places(matrix: Any, n: int, place: Path) -> list[tuple[int, int]]:
    """Return the entries of a matrix that a number of its document stands for."""
    match place:
        case (int(i), int(j)):
            return [(i, j)]
        case ("diagonal", int(i)):
            return [(i, i)]
        case ("bands", str(offset), int(i)):
            j = i + int(offset)
            return [(i, j)] if i == j else [(i, j), (j, i)]
        case ("data", int(k)):
            return [(matrix.row[k], matrix.col[k])]
        case _:  # the scalar
            return [(i, i) for i in range(n)]


def _of_stop(document: Any, parameter: Parameter, index: int, rest: Path) -> Parameter | None:
    """Return the rates of a stop with one of its numbers."""
    match rest:
        case ("gap",):
            stop = StopRate(index, lower=1.0, upper=1.0)
        case ("gap", "lower"):
            stop = StopRate(index, lower=1.0)
        case ("gap", "upper"):
            stop = StopRate(index, upper=1.0)
        case ("restitution",) | ("law", "restitution"):
            stop = StopRate(index, restitution=1.0)
        case ("direction", "weights", int(k)):
            stop = StopRate(index, weights=((document.direction.dofs[k], 1.0),))
        case _:
            return None
    return replace(parameter, stops=(stop,))


def _of_dashpot(document: Any, n: int, parameter: Parameter, rest: Path) -> Parameter | None:
    """Return the rates of the damping matrix with one of the numbers of a dashpot."""
    w = np.zeros(n)
    w[document.dofs] = document.weights
    match rest:
        case ("c",):
            change = np.outer(w, w)
        case ("weights", int(k)):
            turned = np.zeros(n)
            turned[document.dofs[k]] = document.c
            change = np.outer(w, turned) + np.outer(turned, w)
        case _:
            return None
    return replace(parameter, C=MatrixRate(entries=SymmetricMatrix.dense(change)))


def _diagonal(*entries: float) -> MatrixRate:
    return MatrixRate(entries=SymmetricMatrix.diagonal(entries))


def _by_coupling(parameter: Parameter, of: systems.TwoMass) -> Parameter:
    square = of.Omega0 * of.Omega0
    entries = SymmetricMatrix.dense([[square, -square], [-square, square]])
    return replace(parameter, K=MatrixRate(entries=entries))


def _by_frequency(parameter: Parameter, of: systems.Oscillator | systems.TwoMass) -> Parameter:
    """Return the rates with Omega0 of K, which goes with its square, and of C."""
    damping = (2.0 * of.zeta, 0.0)[: 1 if isinstance(of, systems.Oscillator) else 2]
    C = _diagonal(*damping) if of.zeta else MatrixRate()
    return replace(parameter, K=MatrixRate(factor=2.0 / of.Omega0), C=C)


_PRESETS: Final[Mapping[tuple[str, str], Callable[[Parameter, Any], Parameter]]] = {
    ("chain", "mass"): lambda p, of: replace(p, M=MatrixRate(factor=1.0 / of.mass)),
    ("chain", "stiffness"): lambda p, of: replace(p, K=MatrixRate(factor=1.0 / of.stiffness)),
    ("oscillator", "Omega0"): _by_frequency,
    ("oscillator", "zeta"): lambda p, of: replace(p, C=_diagonal(2.0 * of.Omega0)),
    ("two_mass", "Omega0"): _by_frequency,
    ("two_mass", "coupling"): _by_coupling,
    ("two_mass", "zeta"): lambda p, of: replace(p, C=_diagonal(2.0 * of.Omega0, 0.0)),
    ("double_pendulum", "mu"): lambda p, of: replace(
        p, M=_diagonal(2.0 * of.mu, 0.0), K=_diagonal(2.0 * of.mu, 0.0)
    ),
    ("bouncing_ball", "g"): lambda p, of: replace(p, force=np.array([-1.0])),
}
"""Rates of presets with their parameters."""
