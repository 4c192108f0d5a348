"""The loop of time histories with its inner calls counted, or with what it leaves out put back.

The loop is compiled as one piece, so that nothing in it can be replaced at run time. To be
counted, a twin of it is run by Python's interpreter, which takes the same path with the same
numbers (`vibroimpact_solvers.kernels.plain`): copies of the functions of all modules of kernels
that it reaches, which call one another and can be replaced. Nothing is compiled for it.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from threading import Lock
from types import FunctionType, ModuleType, SimpleNamespace
from typing import Any, Final
from unittest import mock

import numpy as np

from vibroimpact_solvers.kernels import jit, next_impact, plain, rigid_motion
from vibroimpact_solvers.time_history import rigid_motions, run

_COUNTED: Final = {
    "derivatives": "coordinates expanded",
    "near_derivatives": "coordinates expanded",
    "propagate": "states advanced",
    "propagate_state": "states advanced",
}
"""What is counted when the loop calls a function of `kernels.flow`."""
_LOOPS: Final = (next_impact, rigid_motion)
"""The modules whose calls are counted."""

LOCK: Final = Lock()
"""Held while numbers are counted: several threads may."""


@contextmanager
def counted(counts: Counter[str]) -> Iterator[None]:
    """Count in the loop: expansions of one coordinate, and states taken to another time."""
    with ExitStack() as stack:
        for module in _LOOPS:
            names = _twin(module)
            replaced = {
                name: _counter(names[name], what, counts)
                for name, what in _COUNTED.items()
                if name in names
            }
            stack.enter_context(mock.patch.dict(names, replaced))
        loop = _entered(_twin(rigid_motion)["follow"])
        stack.enter_context(mock.patch.object(run, "follow", loop))
        stack.enter_context(mock.patch.object(rigid_motions, "follow", loop))
        yield


@contextmanager
def watching_all() -> Iterator[None]:
    """Let the loop search all walls in every free motion, those that are out of reach included.

    Only inside `counted`, which lets Python's interpreter run the loop.
    """
    search = _twin(next_impact)["next_event"]

    def awake(structure: Any, motion: Any, scratch: Any) -> Any:
        scratch.in_reach[:] = True
        return search(structure, motion, scratch)

    with mock.patch.dict(_twin(rigid_motion), next_event=awake):
        yield


_SUPPLIED: Final = ("fma", "is_odd_bit", "never_inlined")
"""What compiled code has and Python has not."""

_TWINS: Final[dict[str, dict[str, Any]]] = {}
"""Names of modules of kernels, with plain functions in place of compiled ones."""


def _twin(module: ModuleType) -> dict[str, Any]:
    """Return the names of the twin of a module, which its functions have as their globals."""
    names = _TWINS.get(module.__name__)
    if names is None:
        names = _TWINS[module.__name__] = dict(vars(module))
        names |= {name: _plain(value) for name, value in vars(module).items()}
    return names


def _plain(value: Any) -> Any:
    """Return what stands for a value of a module in its twin."""
    for name in _SUPPLIED:
        if value is getattr(jit, name):
            return getattr(plain, name)
    if isinstance(value, ModuleType) and value.__name__.startswith("vibroimpact_solvers.kernels"):
        return SimpleNamespace(**_twin(value))
    if not hasattr(value, "py_func"):
        return value
    function = value.py_func
    names = _twin(sys.modules[function.__module__])
    parts = function.__code__, names, function.__name__, function.__defaults__, function.__closure__
    return plain.uncompiled(FunctionType(*parts))


def _counter(function: Any, what: str, counts: Counter[str]) -> Callable[..., Any]:
    def called(*args: Any) -> Any:
        with LOCK:
            counts[what] += 1
        return function(*args)

    return called


def _entered(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function that is called as a kernel is: its records have attributes for columns."""
    kernel = plain.entered(function)
    return lambda *args: kernel(*map(_named_rows, args))


def _named_rows(given: Any) -> Any:
    if isinstance(given, tuple):
        parts = map(_named_rows, given)
        return type(given)(*parts) if hasattr(given, "_fields") else tuple(parts)
    if isinstance(given, np.ndarray) and given.dtype.names:
        return given.view(_record(given.dtype))
    return given


@cache
def _record(rows: np.dtype[Any]) -> np.dtype[Any]:
    """Return the type that records have where kernels run as plain Python."""
    assert rows.fields is not None
    with mock.patch.object(plain, "PLAIN", True):
        return plain.record([(name, rows.fields[name][0]) for name in rows.names or ()])
