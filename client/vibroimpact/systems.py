"""Documents of structures, constraints and loads, made from numbers and arrays."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

Document = dict[str, Any]


def constraint(
    dof: int | None = None,
    gap: float | Mapping[str, float | None] = 0.0,
    restitution: float = 1.0,
    *,
    direction: Mapping[int, float] | None = None,
) -> Document:
    """Return the document of a rigid amplitude limiter.

    Parameters
    ----------
    dof : int
        Index of the constrained degree of freedom, from 0.
    gap : float or mapping
        Distance to both walls, or ``{"lower": l, "upper": u}``; None stands for no wall.
    restitution : float
        Newton's coefficient of restitution; 1 is elastic.
    direction : mapping of int to float
        Alternative to `dof`: weight of each degree of freedom in the constrained coordinate.
    """
    limits = dict(gap) if isinstance(gap, Mapping) else float(gap)
    document: Document = {"gap": limits, "restitution": float(restitution)}
    if direction is not None:
        dofs, weights = list(direction), [float(w) for w in direction.values()]
        return document | {"direction": {"dofs": dofs, "weights": weights}}
    return document | {"dof": dof}


def chain(
    n: int, constraints: Iterable[Document], mass: float = 1.0, stiffness: float = 1.0
) -> Document:
    """Return a chain of n equal masses and equal springs between fixed ends (eq. 10.60)."""
    return _preset("chain", constraints, n=n, mass=float(mass), stiffness=float(stiffness))


def oscillator(constraints: Iterable[Document], Omega0: float = 1.0, zeta: float = 0.0) -> Document:
    """Return an oscillator with one degree of freedom."""
    return _preset("oscillator", constraints, Omega0=float(Omega0), zeta=float(zeta))


def two_mass(
    constraints: Iterable[Document], Omega0: float = 1.0, coupling: float = 1.0, zeta: float = 0.0
) -> Document:
    """Return two coupled oscillators (eq. 10.22, 10.42)."""
    return _preset(
        "two_mass", constraints, Omega0=float(Omega0), coupling=float(coupling), zeta=float(zeta)
    )


def double_pendulum(constraints: Iterable[Document], mu: float) -> Document:
    """Return the linearised double pendulum (eq. 10.33)."""
    return _preset("double_pendulum", constraints, mu=float(mu))


def bouncing_ball(constraints: Iterable[Document], g: float = 9.81) -> Document:
    """Return a ball above a floor, under gravity."""
    return _preset("bouncing_ball", constraints, g=float(g))


def system(
    M: Any,
    K: Any,
    constraints: Iterable[Document],
    C: Any = None,
    force: Sequence[float] | None = None,
    units: Mapping[str, str] | None = None,
) -> Document:
    """Return a structure given by its matrices.

    Parameters
    ----------
    M, K, C : array, shape (n, n), or sparse matrix
        Mass, stiffness and damping. An array of shape (n,) is a diagonal.
    constraints : iterable of dict
        Rigid limiters, from `constraint`.
    force : sequence of float, optional
        Static load.
    units : mapping, optional
        ``{"length": "m", "mass": "kg", "time": "s"}``.
    """
    document: Document = {"M": matrix(M), "K": matrix(K), "constraints": _several(constraints)}
    if C is not None:
        document["C"] = matrix(C)
    if force is not None:
        document["force"] = [float(f) for f in force]
    if units is not None:
        document["units"] = dict(units)
    return document


def matrix(given: Any) -> Any:
    """Return the shortest document of a matrix: diagonal, coordinates or rows."""
    if hasattr(given, "tocoo"):
        entries = given.tocoo()
        return {
            "shape": [int(side) for side in entries.shape],
            "row": np.asarray(entries.row).tolist(),
            "col": np.asarray(entries.col).tolist(),
            "data": np.asarray(entries.data, dtype=np.float64).tolist(),
        }
    full = np.asarray(given, dtype=np.float64)
    if full.ndim == 1:
        return {"diagonal": full.tolist()}
    return full.tolist()


def frequencies(given: Any, unit: str = "Omega") -> Document:
    """Return the document of frequencies: an array, a mapping, or (start, stop, num)."""
    return {"unit": unit} | times(given)


def times(given: Any) -> Document:
    """Return the document of times: an array, a mapping, or (start, stop, num)."""
    if isinstance(given, Mapping):
        return dict(given)
    if isinstance(given, tuple) and len(given) == 3:
        start, stop, num = given
        return {"start": float(start), "stop": float(stop), "num": int(num)}
    return {"values": np.atleast_1d(np.asarray(given, dtype=np.float64)).tolist()}


def axis(path: str, values: Any) -> Document:
    """Return the document of a sweep axis.

    Parameters
    ----------
    path : str
        Path of the number that varies, such as ``"system.constraints.0.gap"``.
    values : array, (start, stop, num) or dict
        Values of the number. Sweeps over ``start``, ``stop`` and ``step`` reuse the parts that
        longer or shifted sweeps with the same step have computed; ``name`` names the dimension.
    """
    return {"path": path} | times(values)


def _preset(name: str, constraints: Iterable[Document], **parameters: Any) -> Document:
    return {"preset": name, **parameters, "constraints": _several(constraints)}


def _several(constraints: Iterable[Document] | Document) -> list[Document]:
    """Return a list, also of a single constraint."""
    return [constraints] if isinstance(constraints, dict) else list(constraints)


def names(outputs: Sequence[str]) -> list[str]:
    """Return the names of outputs, also of a single one."""
    return [outputs] if isinstance(outputs, str) else list(outputs)


def harmonic(dof: int, amplitude: float, frequency: float, phase: float = 0.0) -> Document:
    """Return a load ``amplitude cos(frequency t + phase)`` on one degree of freedom."""
    return {
        "dof": int(dof),
        "amplitude": float(amplitude),
        "frequency": float(frequency),
        "phase": float(phase),
    }


def drive(
    dof: int | Mapping[int, float],
    amplitude: float,
    harmonic: int = 1,
    phase: float = 0.0,
) -> Document:
    """Return a load ``amplitude cos(harmonic Omega t + phase)`` of periodic motions.

    It acts on one degree of freedom, or on several given as {dof: weight}.
    """
    if isinstance(dof, Mapping):
        weights = [float(weight) for weight in dof.values()]
        place: Document = {"direction": {"dofs": [int(d) for d in dof], "weights": weights}}
    else:
        place = {"dof": int(dof)}
    terms = {"amplitude": float(amplitude), "harmonic": int(harmonic), "phase": float(phase)}
    return place | terms


def soft(exponent: float = 17.0, stiffness: float = 1.0, scale: float = 1.0) -> Document:
    """Return soft limiters with the force ``-stiffness (y / (scale gap))^exponent``."""
    return {
        "law": "power",
        "exponent": float(exponent),
        "stiffness": float(stiffness),
        "scale": float(scale),
    }
