"""Documents of structures, made from numbers and arrays: by their matrices, and presets.

The documents of their parts come from `stops` and `loads`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np

from vibroimpact.arguments import array, integer, number, numbers, unit_names
from vibroimpact.loads import base_motion, base_vibration, drive, harmonic, sampled
from vibroimpact.stops import constraint, dashpot, soft
from vibroimpact.structures import Structure
from vibroimpact_schema.imaginary import real

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from vibroimpact import documents

    Dense = Sequence[Sequence[float]]
    Sparse = documents.DiagonalMatrix | documents.CoordinateMatrix
    Constraints = Iterable[documents.Constraint] | documents.Constraint
    Damping = (
        documents.RatioDamping | documents.RayleighDamping | documents.StructuralDamping | ArrayLike
    )
    Dashpots = Iterable[documents.Dashpot] | documents.Dashpot

__all__ = [
    "absorber",
    "base_motion",
    "base_vibration",
    "beam",
    "bouncing_ball",
    "chain",
    "constraint",
    "dashpot",
    "double_pendulum",
    "drive",
    "harmonic",
    "matrix",
    "oscillator",
    "sampled",
    "soft",
    "system",
    "two_mass",
]

AnyStructure = TypeVar("AnyStructure", bound=Mapping[str, Any])


class SparseMatrix(Protocol):
    """A sparse matrix or array of scipy."""

    def tocoo(self) -> Any:
        """Return its nonzero entries by rows and columns."""


def system(
    M: ArrayLike | SparseMatrix,
    K: ArrayLike | SparseMatrix,
    constraints: Constraints = (),
    C: ArrayLike | SparseMatrix | None = None,
    force: Sequence[float] | None = None,
    units: documents.Units | Mapping[str, str] | None = None,
    *,
    damping: Damping | None = None,
    dashpots: Dashpots = (),
    influence: ArrayLike | None = None,
    residual_flexibility: ArrayLike | None = None,
) -> documents.MatrixSystem:
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
    damping : float, sequence of float or mapping, optional
        Instead of C: a damping ratio of all modes, such as 0.02, or one of each; or a document:
        ``{"rayleigh": [alpha, beta]}``, ``{"rayleigh": {"ratios": [0.02, 0.03], "at": [10.0,
        50.0], "unit": "Hz"}}``, or ``{"structural": eta, "at": Omega}``.
    dashpots : iterable of dict
        Dampers from `dashpot`, which add to C or `damping`.
    influence : array, shape (n,), optional
        Displacements by a unit displacement of the base, such as 1 in its direction: for loads by
        the motion of the base, and for effective masses.
    residual_flexibility : array, shape (constraint, constraint), optional
        Static flexibility at the stops of what a model of few modes leaves out, in series with
        linear stops without damping: ``residual_flexibility`` of `natural_frequencies`.

    Raises
    ------
    ValueError
        If a matrix has an imaginary part.
    """
    document: documents.MatrixSystem = {
        "M": matrix(M, "M"),
        "K": matrix(K, "K"),
        "constraints": several(constraints),
    }
    if C is not None:
        document["C"] = matrix(C, "C")
    if force is not None:
        document["force"] = numbers("force", force)
    if residual_flexibility is not None:
        rows = array("the residual flexibility", residual_flexibility)
        document["residual_flexibility"] = np.atleast_2d(rows).tolist()
    if units is not None:
        names: Any = unit_names(units)
        document["units"] = names
    return _completed(document, damping, dashpots, influence)


def chain(
    n: int,
    constraints: Constraints = (),
    mass: float = 1.0,
    stiffness: float = 1.0,
    *,
    damping: Damping | None = None,
    dashpots: Dashpots = (),
    influence: ArrayLike | None = None,
) -> documents.Chain:
    """Return a chain of n equal masses and equal springs between fixed ends (eq. 10.60).

    `damping`, `dashpots` and `influence` are as of `system`, here and in the other structures.
    """
    document: documents.Chain = {
        "preset": "chain",
        "n": integer("n", n),
        "mass": number("mass", mass),
        "stiffness": number("stiffness", stiffness),
        "constraints": several(constraints),
    }
    return _completed(document, damping, dashpots, influence)


def oscillator(
    constraints: Constraints = (),
    Omega0: float = 1.0,
    zeta: float = 0.0,
    *,
    damping: Damping | None = None,
    dashpots: Dashpots = (),
    influence: ArrayLike | None = None,
) -> documents.Oscillator:
    """Return an oscillator with one degree of freedom."""
    document: documents.Oscillator = {
        "preset": "oscillator",
        "Omega0": number("Omega0", Omega0),
        "zeta": number("zeta", zeta),
        "constraints": several(constraints),
    }
    return _completed(document, damping, dashpots, influence)


def two_mass(
    constraints: Constraints = (),
    Omega0: float = 1.0,
    coupling: float = 1.0,
    zeta: float = 0.0,
    *,
    damping: Damping | None = None,
    dashpots: Dashpots = (),
    influence: ArrayLike | None = None,
) -> documents.TwoMass:
    """Return two coupled oscillators (eq. 10.22, 10.42)."""
    document: documents.TwoMass = {
        "preset": "two_mass",
        "Omega0": number("Omega0", Omega0),
        "coupling": number("coupling", coupling),
        "zeta": number("zeta", zeta),
        "constraints": several(constraints),
    }
    return _completed(document, damping, dashpots, influence)


def double_pendulum(
    constraints: Constraints,
    mu: float,
    *,
    damping: Damping | None = None,
    dashpots: Dashpots = (),
    influence: ArrayLike | None = None,
) -> documents.DoublePendulum:
    """Return the linearised double pendulum (eq. 10.33)."""
    document: documents.DoublePendulum = {
        "preset": "double_pendulum",
        "mu": number("mu", mu),
        "constraints": several(constraints),
    }
    return _completed(document, damping, dashpots, influence)


def absorber(
    constraints: Constraints = (),
    Omega0: float = 1.0,
    ratio: float = 0.05,
    tuning: float = 1.0,
    *,
    damping: Damping | None = None,
    dashpots: Dashpots = (),
    influence: ArrayLike | None = None,
) -> documents.Absorber:
    """Return a mass on a spring that carries a small one, coordinate 1, between stops.

    Parameters
    ----------
    constraints : Constraint or sequence
        Stops, as ``vi.constraint(gap=0.5, direction={1: 1.0, 0: -1.0})`` between the two.
    Omega0 : float
        Natural frequency of the large mass alone.
    ratio : float
        Small mass over the large one.
    tuning : float
        Frequency of the small mass alone over `Omega0`; 0: it has no spring.
    damping, dashpots, influence
        As in `system`.
    """
    document: documents.Absorber = {
        "preset": "absorber",
        "Omega0": number("Omega0", Omega0),
        "ratio": number("ratio", ratio),
        "tuning": number("tuning", tuning),
        "constraints": several(constraints),
    }
    return _completed(document, damping, dashpots, influence)


def beam(
    elements: int,
    constraints: Constraints = (),
    length: float = 1.0,
    EI: float = 1.0,
    rhoA: float = 1.0,
    *,
    damping: Damping | None = None,
    dashpots: Dashpots = (),
    influence: ArrayLike | None = None,
) -> documents.Beam:
    """Return a cantilever of equal Euler-Bernoulli elements.

    The deflection of its tip is coordinate ``2 * elements - 2``.

    Parameters
    ----------
    elements : int
        Number of elements; each node has a deflection and a rotation.
    constraints : Constraint or sequence
        Stops, as ``vi.constraint(dof=2 * elements - 2, gap=0.01)`` at the tip.
    length, EI, rhoA : float
        Length of the beam, bending stiffness, mass per length.
    damping, dashpots, influence
        As in `system`.
    """
    document: documents.Beam = {
        "preset": "beam",
        "elements": integer("elements", elements),
        "length": number("length", length),
        "EI": number("EI", EI),
        "rhoA": number("rhoA", rhoA),
        "constraints": several(constraints),
    }
    return _completed(document, damping, dashpots, influence)


def bouncing_ball(constraints: Constraints, g: float = 9.81) -> documents.BouncingBall:
    """Return a ball above a floor, under gravity."""
    document: documents.BouncingBall = {
        "preset": "bouncing_ball",
        "g": number("g", g),
        "constraints": several(constraints),
    }
    return _completed(document, None, (), None)


def several(constraints: Constraints) -> list[documents.Constraint]:
    """Return a list, also of a single constraint."""
    several: Any = [constraints] if isinstance(constraints, dict) else constraints
    return list(several)


def _completed(
    structure: AnyStructure,
    damping: Damping | None,
    dashpots: Dashpots,
    influence: ArrayLike | None,
) -> AnyStructure:
    """Return the document of a structure, with its damping and its base."""
    document: Any = Structure(**structure)
    if isinstance(damping, Mapping):
        document["damping"] = dict(damping)
    elif damping is not None:
        ratios = numbers("the damping ratios", damping)
        document["damping"] = {"ratio": ratios[0] if np.ndim(damping) == 0 else ratios}
    given = [dashpots] if isinstance(dashpots, Mapping) else list(dashpots)
    if given:
        document["dashpots"] = [dict(each) for each in given]
    if influence is not None:
        document["influence"] = numbers("influence", influence)
    completed: AnyStructure = document
    return completed


def matrix(given: Any, name: str = "the matrix") -> Dense | Sparse:
    """Return the shortest document of a matrix: diagonal, coordinates or rows."""
    if hasattr(given, "tocoo"):
        entries = real(name, given).tocoo()
        return {
            "shape": [int(side) for side in entries.shape],
            "row": np.asarray(entries.row).tolist(),
            "col": np.asarray(entries.col).tolist(),
            "data": np.asarray(entries.data, dtype=np.float64).tolist(),
        }
    if isinstance(given, str | PathLike):
        raise TypeError(f"{name} must be numbers, not {given!r:.60}; read_model reads files")
    full = array(name, given)
    if full.ndim == 0:
        return [[float(full)]]
    if full.ndim == 1:
        return {"diagonal": full.tolist()}
    rows: Dense = full.tolist()
    return rows
