"""Request documents of every kind of computation but sweeps, made from numbers and arrays.

Each function takes what the method of the same name takes; `vibroimpact.sweeps` makes the
requests of sweeps.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from numbers import Integral
from typing import Any

import numpy as np

from vibroimpact.systems import Document, frequencies, names, times


def impact_modes_request(
    system: Document,
    frequency: Any,
    *,
    unit: str = "Omega",
    outputs: Sequence[str] = ("impulse", "exists", "reason"),
    active: Sequence[int] | None = None,
    dofs: Sequence[int] | None = None,
    tau: Any = None,
) -> Document:
    """Return the request document that `Client.impact_modes` sends."""
    return {
        "system": dict(system),
        "frequency": frequencies(frequency, unit),
        "outputs": names(outputs),
    } | _present(active=_indices(active), dofs=_indices(dofs), tau=_values(tau))


def existence_bands_request(
    system: Document,
    start: float,
    stop: float,
    *,
    unit: str = "Omega",
    outputs: Sequence[str] = ("bands", "rejected"),
    active: Sequence[int] | None = None,
    tolerance: float | None = None,
) -> Document:
    """Return the request document that `Client.existence_bands` sends."""
    return {
        "system": dict(system),
        "frequency": {"start": float(start), "stop": float(stop), "unit": unit},
        "outputs": names(outputs),
    } | _present(active=_indices(active), tolerance=_number(tolerance))


def resonances_request(system: Document, constraint: int = 0, odd_max: int = 9) -> Document:
    """Return the request document that `Client.resonances` sends."""
    return {"system": dict(system), "constraint": int(constraint), "odd_max": int(odd_max)}


def time_history_request(
    system: Document,
    initial: Any,
    t_end: float,
    *,
    t: Any = None,
    outputs: Sequence[str] | None = None,
    dofs: Sequence[int] | None = None,
    load: Sequence[Mapping[str, Any]] | None = None,
    limiter: Mapping[str, Any] | None = None,
    method: str = "exact",
    tolerance: float | None = None,
    digits: int | None = None,
) -> Document:
    """Return the request document that `Client.time_history` sends."""
    if outputs is None:
        at_times = () if t is None else ("x", "v", "energy")
        outputs = (*at_times, "impacts", "contacts")
    return {
        "system": dict(system),
        "initial": _initial(initial),
        "t_end": float(t_end),
        "outputs": names(outputs),
    } | _present(
        t={"num": int(t)} if isinstance(t, Integral) else _values(t),
        dofs=_indices(dofs),
        load=None if load is None else [dict(term) for term in load],
        limiter=None if limiter is None else dict(limiter),
        method=None if method == "exact" else method,
        tolerance=_number(tolerance),
        digits=None if digits is None else int(digits),
    )


def ensemble_request(system: Document, x: Any, v: Any, t_end: float, **options: Any) -> Document:
    """Return the request document that `Client.ensemble` sends; options as it takes them."""
    states = {
        name: np.atleast_2d(np.asarray(given, dtype=np.float64)).tolist()
        for name, given in (("x", x), ("v", v))
    }
    return time_history_request(system, states, t_end, **options)


def slow_flow_request(
    system: Document,
    model: str,
    variant: str,
    initial: Mapping[str, float],
    t: Any,
    *,
    outputs: Sequence[str] = ("state", "x", "v", "error"),
) -> Document:
    """Return the request document that `Client.slow_flow` sends."""
    start = {name: value if name == "root" else float(value) for name, value in initial.items()}
    return {
        "system": dict(system),
        "model": model,
        "variant": variant,
        "initial": start,
        "t": times(t),
        "outputs": names(outputs),
    }


def _present(**fields: Any) -> Document:
    """Return the fields that have a value; those without one keep the service's default."""
    return {name: value for name, value in fields.items() if value is not None}


def _indices(given: Iterable[int] | None) -> list[int] | None:
    return None if given is None else [int(index) for index in given]


def _number(given: float | None) -> float | None:
    return None if given is None else float(given)


def _values(given: Any) -> list[float] | None:
    if given is None:
        return None
    values: list[float] = np.atleast_1d(np.asarray(given, dtype=np.float64)).tolist()
    return values


def _initial(initial: Any) -> Document:
    """Return the initial state: a document, the frequency of an impact mode, or (x, v)."""
    if isinstance(initial, Mapping):
        return dict(initial)
    if isinstance(initial, int | float):
        return {"impact_mode": {"Omega": float(initial)}}
    x, v = initial
    return {"x": _values(x), "v": _values(v)}
