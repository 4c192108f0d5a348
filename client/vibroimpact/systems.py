"""Documents of structures, constraints and loads, made from numbers and arrays."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from numbers import Integral
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeVar

import numpy as np

from vibroimpact.arguments import array, integer, integers, number, numbers, real
from vibroimpact.structures import Structure

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from vibroimpact import documents

    Dense = Sequence[Sequence[float]]
    Sparse = documents.DiagonalMatrix | documents.CoordinateMatrix
    Constraints = Iterable[documents.Constraint] | documents.Constraint
    BaseQuantity = Literal["acceleration", "velocity", "displacement"]
    Damping = (
        documents.RatioDamping | documents.RayleighDamping | documents.StructuralDamping | ArrayLike
    )
    Dashpots = Iterable[documents.Dashpot] | documents.Dashpot

Document = dict[str, Any]
AnyStructure = TypeVar("AnyStructure", bound=Mapping[str, Any])


class SparseMatrix(Protocol):
    """A sparse matrix or array of scipy."""

    def tocoo(self) -> Any:
        """Return its nonzero entries by rows and columns."""


def constraint(
    dof: int | None = None,
    gap: float | documents.Limits | Mapping[str, float | None] = 0.0,
    restitution: float | None = None,
    *,
    direction: Mapping[int, float] | None = None,
    stiffness: float | None = None,
    damping: float | None = None,
) -> documents.Constraint:
    """Return the document of a stop: rigid, or with a stiffness.

    Parameters
    ----------
    dof : int
        Index of the constrained degree of freedom, from 0.
    gap : float or mapping
        Distance to both walls, or ``{"lower": l, "upper": u}``; None stands for no wall.
    restitution : float, optional
        Newton's coefficient of restitution of a rigid stop, 1 (elastic) where absent; of a stop
        with a stiffness, instead of its damping, that of a free mass.
    direction : mapping of int to float
        Alternative to `dof`: weight of each degree of freedom in the constrained coordinate.
    stiffness : float, optional
        Force by length beyond the wall; absent: the stop is rigid.
    damping : float, optional
        Force by velocity there; the force of the stop never pulls.

    Examples
    --------
    >>> from vibroimpact import constraint
    >>> constraint(0, gap=0.1, stiffness=1e4, damping=2.0)["law"]
    {'type': 'linear', 'stiffness': 10000.0, 'damping': 2.0}
    """
    limits: Any = dict(gap) if isinstance(gap, Mapping) else number("gap", gap)
    document: documents.Constraint = {"gap": limits}
    if stiffness is not None:
        document["law"] = _linear(stiffness, damping, restitution)
    elif damping is not None:
        raise ValueError("a stop with a damping needs a stiffness, which may be 0")
    else:
        document["restitution"] = 1.0 if restitution is None else number("restitution", restitution)
    if direction is None:
        document["dof"] = None if dof is None else integer("dof", dof)
    else:
        document["direction"] = _direction(direction)
    return document


def dashpot(
    dof: int | None = None, c: float = 0.0, *, direction: Mapping[int, float] | None = None
) -> documents.Dashpot:
    """Return the document of a viscous damper, of a degree of freedom or between several.

    Parameters
    ----------
    dof : int
        Index of the degree of freedom, from 0.
    c : float
        Its force by unit velocity.
    direction : mapping of int to float
        Alternative to `dof`: weight of each degree of freedom, such as ``{3: 1.0, 4: -1.0}``
        between two.
    """
    weights = direction if dof is None else {dof: 1.0}
    if weights is None or (dof is not None and direction is not None):
        raise ValueError("a dashpot needs either a dof or a direction")
    coordinate = _direction(weights)
    return {"dofs": coordinate["dofs"], "weights": coordinate["weights"], "c": number("c", c)}


def _linear(
    stiffness: float, damping: float | None, restitution: float | None
) -> documents.LinearLaw:
    """Return the document of the law of a stop with a stiffness."""
    law: documents.LinearLaw = {"type": "linear", "stiffness": number("stiffness", stiffness)}
    if damping is not None:
        law["damping"] = number("damping", damping)
    if restitution is not None:
        law["restitution"] = number("restitution", restitution)
    return law


def has_stiff_stops(system: Mapping[str, Any]) -> bool:
    """Return whether a constraint of a structure's document has a stiffness."""
    given = system.get("constraints") or ()
    return any((each.get("law") or {}).get("type", "rigid") != "rigid" for each in given)


def chain(
    n: int,
    constraints: Constraints,
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
        "constraints": _several(constraints),
    }
    return _completed(document, damping, dashpots, influence)


def oscillator(
    constraints: Constraints,
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
        "constraints": _several(constraints),
    }
    return _completed(document, damping, dashpots, influence)


def two_mass(
    constraints: Constraints,
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
        "constraints": _several(constraints),
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
        "constraints": _several(constraints),
    }
    return _completed(document, damping, dashpots, influence)


def absorber(
    constraints: Constraints,
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
        "constraints": _several(constraints),
    }
    return _completed(document, damping, dashpots, influence)


def beam(
    elements: int,
    constraints: Constraints,
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
        "constraints": _several(constraints),
    }
    return _completed(document, damping, dashpots, influence)


def bouncing_ball(constraints: Constraints, g: float = 9.81) -> documents.BouncingBall:
    """Return a ball above a floor, under gravity."""
    document: documents.BouncingBall = {
        "preset": "bouncing_ball",
        "g": number("g", g),
        "constraints": _several(constraints),
    }
    return _completed(document, None, (), None)


def system(
    M: ArrayLike | SparseMatrix,
    K: ArrayLike | SparseMatrix,
    constraints: Constraints,
    C: ArrayLike | SparseMatrix | None = None,
    force: Sequence[float] | None = None,
    units: documents.Units | Mapping[str, str] | None = None,
    *,
    damping: Damping | None = None,
    dashpots: Dashpots = (),
    influence: ArrayLike | None = None,
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

    Raises
    ------
    ValueError
        If a matrix has an imaginary part.
    """
    document: documents.MatrixSystem = {
        "M": matrix(M, "M"),
        "K": matrix(K, "K"),
        "constraints": _several(constraints),
    }
    if C is not None:
        document["C"] = matrix(C, "C")
    if force is not None:
        document["force"] = numbers("force", force)
    if units is not None:
        names: Any = dict(units)
        document["units"] = names
    return _completed(document, damping, dashpots, influence)


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
    full = array(name, given)
    if full.ndim == 1:
        return {"diagonal": full.tolist()}
    rows: Dense = full.tolist()
    return rows


def frequencies(given: Any, unit: str = "Omega") -> Document:
    """Return the document of frequencies: an array, a mapping, or (start, stop, num)."""
    return {"unit": unit} | times(given, "frequency")


def times(given: Any, name: str = "the values") -> Document:
    """Return the document of times: an array, a mapping, or (start, stop, num).

    Raises
    ------
    ValueError
        If a tuple of three numbers can be meant as three values.
    """
    if isinstance(given, Mapping):
        return dict(given)
    if isinstance(given, tuple) and len(given) == 3:
        return _equally_spaced(*given)
    return {"values": numbers(name, given)}


_FEW = 10
"""Three integers of which the last is smaller look like three values."""


def _equally_spaced(start: Any, stop: Any, num: Any) -> Document:
    whole = [isinstance(part, Integral) for part in (start, stop, num)]
    if not whole[2] or (all(whole) and num < _FEW):
        raise ValueError(
            f"({start}, {stop}, {num}) can mean three values or (start, stop, num): write "
            f"[{start}, {stop}, {num}] for three values, "
            f'{{"start": {start}, "stop": {stop}, "num": n}} for n equally spaced ones'
        )
    return {
        "start": number("start", start),
        "stop": number("stop", stop),
        "num": integer("num", num),
    }


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
    return {"path": path} | times(values, path)


def _several(constraints: Constraints) -> list[documents.Constraint]:
    """Return a list, also of a single constraint."""
    several: Any = [constraints] if isinstance(constraints, dict) else constraints
    return list(several)


def names(outputs: Sequence[str]) -> list[str]:
    """Return the names of outputs, also of a single one."""
    return [outputs] if isinstance(outputs, str) else list(outputs)


def harmonic(
    dof: int, amplitude: float, frequency: float, phase: float = 0.0
) -> documents.HarmonicLoad:
    """Return a load ``amplitude cos(frequency t + phase)`` on one degree of freedom."""
    return {
        "dof": integer("dof", dof),
        "amplitude": number("amplitude", amplitude),
        "frequency": number("frequency", frequency),
        "phase": number("phase", phase),
    }


def sampled(
    dof: int | Mapping[int, float],
    force: ArrayLike,
    t: ArrayLike | None = None,
    *,
    interval: float | None = None,
) -> documents.SampledLoad:
    """Return a load given by samples, a straight line from each to the next.

    Parameters
    ----------
    dof : int or dict
        The degree of freedom on which it acts, or several as {dof: weight}.
    force : array
        Its values, mass length / time².
    t : array, optional
        Their times, from 0 or before to the end of the motion or after.
    interval : float, optional
        In place of `t`: the time between two samples, the first one at 0.
    """
    load: Any = _place(dof) | {"force": numbers("force", force)} | _sample_times(t, interval)
    document: documents.SampledLoad = load
    return document


def base_motion(
    base: ArrayLike | str,
    acceleration: ArrayLike,
    t: ArrayLike | None = None,
    *,
    interval: float | None = None,
) -> documents.BaseMotion:
    """Return a moving base as a load; displacements and velocities are then relative to it.

    Parameters
    ----------
    base : array
        Displacements of the structure by a unit displacement of the base: 1 for every degree of
        freedom in its direction; or "acceleration": they are the `influence` of the system.
    acceleration : array
        That of the base, a straight line from each sample to the next.
    t, interval : optional
        As for `sampled`.
    """
    moved = base if isinstance(base, str) else numbers("base", base)
    parts: Document = {"base": moved, "acceleration": numbers("acceleration", acceleration)}
    load: Any = parts | _sample_times(t, interval)
    document: documents.BaseMotion = load
    return document


def base_vibration(
    quantity: BaseQuantity,
    amplitude: float,
    frequency: float,
    phase: float = 0.0,
) -> documents.HarmonicBase:
    """Return a base that moves by ``amplitude cos(frequency t + phase)``, as a load of histories.

    Displacements and velocities are relative to it. The system has its `influence`.

    Parameters
    ----------
    quantity : str
        What of the base the amplitude is: "acceleration", "velocity" or "displacement".
    amplitude, frequency, phase : float
        The frequency is angular.
    """
    return {
        "base": quantity,
        "amplitude": number("amplitude", amplitude),
        "frequency": number("frequency", frequency),
        "phase": number("phase", phase),
    }


def _sample_times(t: Any, interval: float | None) -> Document:
    given: Document = {} if t is None else {"t": numbers("t", t)}
    return given if interval is None else given | {"interval": number("interval", interval)}


def _place(dof: int | Mapping[int, float] | None) -> Document:
    if dof is None:
        return {}
    if not isinstance(dof, Mapping):
        return {"dof": integer("dof", dof)}
    return {"direction": _direction(dof)}


def _direction(weights: Mapping[int, float]) -> documents.Direction:
    if not isinstance(weights, Mapping):
        raise TypeError(f"a direction must be {{dof: weight}}, not {weights!r:.60}")
    return {
        "dofs": integers("the degrees of freedom of a direction", list(weights)),
        "weights": [number("a weight", weight) for weight in weights.values()],
    }


def drive(
    dof: int | Mapping[int, float] | None = None,
    amplitude: float = 1.0,
    harmonic: int = 1,
    phase: float = 0.0,
    *,
    base: str | None = None,
    scale: str | None = None,
) -> documents.DriveTerm:
    """Return a load ``amplitude cos(harmonic Omega t + phase)`` of periodic motions.

    Parameters
    ----------
    dof : int or mapping
        The degree of freedom on which it acts, or several given as {dof: weight}.
    amplitude, harmonic, phase
        As above.
    base : str, optional
        Instead of `dof`: "acceleration", "velocity" or "displacement" of the base, by the
        `influence` of the system; displacements are then relative to it.
    scale : str, optional
        "Omega2" multiplies the amplitude by the square of Omega, as of an unbalance.
    """
    terms = {
        "amplitude": number("amplitude", amplitude),
        "harmonic": integer("harmonic", harmonic),
        "phase": number("phase", phase),
    }
    load: Any = _place(dof) | terms
    if base is not None:
        load["base"] = base
    if scale is not None:
        load["scale"] = scale
    document: documents.DriveTerm = load
    return document


def soft(
    exponent: float = 17.0, stiffness: float = 1.0, scale: float = 1.0
) -> documents.PowerLimiter:
    """Return soft limiters with the force ``-stiffness (y / (scale gap))^exponent``."""
    return {
        "law": "power",
        "exponent": number("exponent", exponent),
        "stiffness": number("stiffness", stiffness),
        "scale": number("scale", scale),
    }
