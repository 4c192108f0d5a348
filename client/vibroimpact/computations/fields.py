"""Fields of requests from the arguments of methods; None where an argument is absent."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from numbers import Integral
from typing import TYPE_CHECKING, Any

from vibroimpact import arguments
from vibroimpact.arguments import Document
from vibroimpact.grids import times

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from vibroimpact import documents

    Values = ArrayLike | Mapping[str, object]
    """An array, (start, stop, num), or a document with start, stop and num or step."""
    Initial = documents.InitialState | documents.InitialMode | float | tuple[ArrayLike, ArrayLike]
    Initials = (
        Initial | documents.InitialStates | Sequence[documents.InitialState | documents.InitialMode]
    )


def present(**fields: Any) -> Document:
    """Return the fields that have a value; those without one keep the service's default."""
    return {name: value for name, value in fields.items() if value is not None}


def indices(name: str, given: Iterable[int] | None) -> list[int] | None:
    """Return indices, such as degrees of freedom."""
    return None if given is None else arguments.integers(name, given)


def number(name: str, given: float | None) -> float | None:
    """Return a real number."""
    return None if given is None else arguments.number(name, given)


def integer(name: str, given: int | None) -> int | None:
    """Return an integer."""
    return None if given is None else arguments.integer(name, given)


def values(name: str, given: ArrayLike | None) -> list[float] | None:
    """Return real numbers as a list."""
    return None if given is None else arguments.numbers(name, given)


def output_times(given: Any) -> Any:
    """Return the output times of a motion: a number of them, a list, or a grid."""
    if given is None or isinstance(given, Integral):
        return None if given is None else {"num": int(given)}
    document = times(given, "t")
    return document["values"] if set(document) == {"values"} else document


def drive_terms(load: Any) -> list[Document]:
    """Return the terms of a periodic drive, whose frequency is that of the request."""
    terms = arguments.documents("load", load)
    if any("frequency" in each for each in terms):
        raise TypeError(
            "a term of load has a frequency of its own, as from `harmonic`; terms of a periodic "
            "drive come from `drive`, and their frequency is that of the request"
        )
    return terms


def initial_state(initial: Initial) -> Document:
    """Return the initial state: a document, the frequency of an impact mode, or (x, v)."""
    if isinstance(initial, Mapping):
        return dict(initial)
    if isinstance(initial, int | float):
        return {"impact_mode": {"Omega": float(initial)}}
    several = hasattr(initial, "__len__") and not isinstance(initial, str | bytes)
    if not several or len(initial) != 2:
        given = f"{len(initial)} numbers" if several else f"{initial!r:.60}"
        raise TypeError(
            "initial must be (x, v), displacements and velocities, a document, or the frequency "
            f"of an impact mode, not {given}"
        )
    x, v = initial
    return {"x": values("x", x), "v": values("v", v)}


def initial_states(x: Any, v: Any, initial: Any) -> Any:
    """Return the initial states of many motions, given as x and v or as one argument."""
    if (initial is None) == (x is None and v is None):
        raise TypeError("give x and v, or initial: the states from which the motions start")
    if initial is None:
        if x is None or v is None:
            raise TypeError("x and v go together: displacements and velocities")
        return {name: arguments.rows(name, given) for name, given in (("x", x), ("v", v))}
    if isinstance(initial, Mapping):
        return dict(initial)
    if isinstance(initial, int | float):
        return initial_state(initial)
    several = isinstance(initial, Sequence) and not isinstance(initial, str | bytes)
    if several and initial and all(isinstance(each, Mapping) for each in initial):
        return [dict(each) for each in initial]
    if not hasattr(initial, "__len__") or len(initial) != 2:
        raise TypeError(
            "initial must be (x, v), displacements and velocities, a document, a list of "
            f"documents, or the frequency of an impact mode, not {initial!r:.60}"
        )
    return initial_states(initial[0], initial[1], None)
