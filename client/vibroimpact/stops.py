"""Documents of what limits and damps single coordinates: stops and dashpots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

from vibroimpact.arguments import integer, integers, number, numbers

if TYPE_CHECKING:
    from vibroimpact import documents

    Wall = Sequence[Mapping[str, float]] | Mapping[str, Any]


def constraint(
    dof: int | Mapping[int, float] | None = None,
    gap: float | documents.Limits | Mapping[str, float | None] = 0.0,
    restitution: float | None = None,
    *,
    direction: Mapping[int, float] | None = None,
    stiffness: float | None = None,
    damping: float | None = None,
    law: Literal["linear", "hertz", "power"] = "linear",
    exponent: float | None = None,
    wall: Wall | None = None,
) -> documents.Constraint:
    """Return the document of a stop: rigid, or with a stiffness.

    Parameters
    ----------
    dof : int or mapping
        Index of the constrained degree of freedom, from 0; or the weight of each, where the
        constrained coordinate is a sum: ``{3: 1.0, 4: -1.0}`` is a gap between two.
    gap : float or mapping
        Distance to both walls, or ``{"lower": l, "upper": u}``; None stands for no wall.
    restitution : float, optional
        Newton's coefficient of restitution of a rigid stop, 1 (elastic) where absent; of a stop
        with a stiffness, instead of its damping, that of a free mass.
    direction : mapping of int to float
        Another name of a `dof` that is a sum.
    stiffness : float, optional
        Force by length beyond the wall; absent: the stop is rigid.
    damping : float, optional
        Force by velocity there; the force of the stop never pulls.
    law : str
        Of a stop with a stiffness k and the indentation d: ``"linear"``, k d and its damping;
        ``"hertz"``, k d^(3/2); ``"power"``, k d^n.
    exponent : float, optional
        n of the power law.
    wall : sequence of mapping or mapping, optional
        How both walls of a stop with a stiffness move: harmonic terms, as ``[{"amplitude": 0.01,
        "frequency": 2.0, "phase": 0.0}]``, or samples ``{"t": times, "y": displacements}`` with
        straight lines between. In periodic motions, harmonics of the drive: ``[{"amplitude": 0.01,
        "harmonic": 1, "phase": 0.0}]``.

    Examples
    --------
    >>> from vibroimpact import constraint
    >>> constraint(0, gap=0.1, stiffness=1e4, damping=2.0)["law"]
    {'type': 'linear', 'stiffness': 10000.0, 'damping': 2.0}
    >>> constraint(0, gap=0.1, stiffness=1e6, law="hertz")["law"]
    {'type': 'hertz', 'stiffness': 1000000.0}
    """
    limits: Any = gap
    if isinstance(limits, tuple | list) and len(limits) == 2:
        lower, upper = limits
        raise TypeError(
            f'gap must be a number or {{"lower": {lower}, "upper": {upper}}}, not {limits!r:.60}'
        )
    limits = dict(limits) if isinstance(limits, Mapping) else number("gap", limits)
    document: documents.Constraint = {"gap": limits}
    if law != "linear" or exponent is not None:
        document["law"] = _grown(law, stiffness, exponent, damping, restitution)
    elif stiffness is not None:
        document["law"] = _linear(stiffness, damping, restitution)
    elif damping is not None:
        raise ValueError("a stop with a damping needs a stiffness, which may be 0")
    else:
        document["restitution"] = 1.0 if restitution is None else number("restitution", restitution)
    if wall is not None:
        document["wall"] = _wall(wall)
    if dof is not None and direction is not None:
        raise ValueError("a constraint has either a dof or a direction")
    weights = dof if isinstance(dof, Mapping) else direction
    if weights is None:
        document["dof"] = None if dof is None else integer("dof", dof)
    else:
        document["direction"] = direction_of(weights)
    return document


def _wall(wall: Wall) -> Sequence[documents.WallSwing] | documents.WallSamples:
    """Return the document of walls that move."""
    if isinstance(wall, Mapping) and "t" in wall:
        return {"t": numbers("t of the wall", wall["t"]), "y": numbers("y", wall["y"])}
    terms: list[documents.WallSwing] = []
    for each in [wall] if isinstance(wall, Mapping) else wall:
        term: Any = {
            name: (integer if name == "harmonic" else number)(f"{name} of the wall", value)
            for name, value in each.items()
        }
        terms.append(term)
    return terms


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


def _grown(
    law: str,
    stiffness: float | None,
    exponent: float | None,
    damping: float | None,
    restitution: float | None,
) -> documents.HertzLaw | documents.PowerLaw:
    """Return the document of a law whose force grows with a power of the indentation."""
    if law not in ("hertz", "power"):
        raise ValueError(f'an exponent belongs to the law "power", not to {law!r:.60}')
    if stiffness is None:
        raise ValueError(f"a stop with the law {law!r} needs a stiffness")
    if damping is not None or restitution is not None:
        raise ValueError(f"a stop with the law {law!r} loses no energy: no damping, no restitution")
    if (exponent is None) != (law == "hertz"):
        raise ValueError('the law "power" needs an exponent, and "hertz" has that of 3/2')
    if exponent is None:
        return {"type": "hertz", "stiffness": number("stiffness", stiffness)}
    return {
        "type": "power",
        "stiffness": number("stiffness", stiffness),
        "exponent": number("exponent", exponent),
    }


def has_stiff_stops(system: Mapping[str, Any]) -> bool:
    """Return whether a constraint of a structure's document has a stiffness."""
    given = system.get("constraints") or ()
    return any((each.get("law") or {}).get("type", "rigid") != "rigid" for each in given)


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


def dashpot(
    dof: int | Mapping[int, float] | None = None,
    c: float = 0.0,
    *,
    direction: Mapping[int, float] | None = None,
) -> documents.Dashpot:
    """Return the document of a viscous damper, of a degree of freedom or between several.

    Parameters
    ----------
    dof : int or mapping
        Index of the degree of freedom, from 0; or the weight of each, such as
        ``{3: 1.0, 4: -1.0}`` between two.
    c : float
        Its force by unit velocity.
    direction : mapping of int to float
        Another name of a `dof` that is a sum.
    """
    weights = direction if dof is None else dof if isinstance(dof, Mapping) else {dof: 1.0}
    if weights is None or (dof is not None and direction is not None):
        raise ValueError("a dashpot needs either a dof or a direction")
    coordinate = direction_of(weights)
    return {"dofs": coordinate["dofs"], "weights": coordinate["weights"], "c": number("c", c)}


def direction_of(weights: Mapping[int, float]) -> documents.Direction:
    """Return the document of a coordinate that is a sum of weighted degrees of freedom."""
    if not isinstance(weights, Mapping):
        raise TypeError(f"a direction must be {{dof: weight}}, not {weights!r:.60}")
    return {
        "dofs": integers("the degrees of freedom of a direction", list(weights)),
        "weights": [number("a weight", weight) for weight in weights.values()],
    }
