"""The loop of time histories with its inner calls counted, or with what it leaves out put back.

The loop is compiled as one piece, so that nothing in it can be replaced at run time. To be
counted it is run by Python's interpreter, which takes the same path with the same numbers: the
functions that it calls for each watched coordinate and for each state are compiled ones.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from threading import Lock
from types import ModuleType
from typing import Any, Final
from unittest import mock

import numpy as np

from tests.solvers.kernels.compiled import compiled
from vibroimpact_solvers.kernels import flow, modal, next_impact, rigid_motion, rigid_state
from vibroimpact_solvers.time_history import rigid_motions, run

_COUNTED: Final = {
    "derivatives": "coordinates expanded",
    "near_derivatives": "coordinates expanded",
    "propagate": "states advanced",
    "propagate_state": "states advanced",
}
"""What is counted when the loop calls a function of `kernels.flow`."""
_NAMING: Final = ("structure_of", "scratch_of", "modal_of")
_LOOPS: Final[dict[ModuleType, tuple[str, ...]]] = {
    next_impact: ("next_event", "_expanded", "_closing_in"),
    rigid_motion: ("_take_samples", "_move", "_advance"),
}
"""The functions that the interpreter runs."""

LOCK: Final = Lock()
"""Held while numbers are counted: several threads may."""


@contextmanager
def counted(counts: Counter[str]) -> Iterator[None]:
    """Count in the loop: expansions of one coordinate, and states taken to another time."""
    interpreted = {name for names in _LOOPS.values() for name in names} | {*_NAMING}
    with ExitStack() as stack:
        for module in _LOOPS:
            for name, function in list(vars(module).items()):
                if not hasattr(function, "py_func"):
                    continue
                replaced = _FUNCTIONS[name] if name in interpreted else compiled(function)
                if name in _COUNTED:
                    replaced = _counter(replaced, _COUNTED[name], counts)
                stack.enter_context(mock.patch.object(module, name, replaced))
        loop = _quietly(_FUNCTIONS["follow"])
        stack.enter_context(mock.patch.object(run, "follow", loop))
        stack.enter_context(mock.patch.object(rigid_motions, "follow", loop))
        yield


@contextmanager
def watching_all() -> Iterator[None]:
    """Let the loop search all walls in every free motion, those that are out of reach included.

    Only inside `counted`, which lets Python's interpreter run the loop.
    """
    search = next_impact.next_event

    def awake(structure: Any, motion: Any, scratch: Any) -> Any:
        scratch.in_reach[:] = True
        return search(structure, motion, scratch)

    with mock.patch.object(rigid_motion, "next_event", awake):
        yield


_FUNCTIONS: Final = {
    name: value.py_func
    for module in (flow, modal, rigid_state, *_LOOPS)
    for name, value in vars(module).items()
    if hasattr(value, "py_func")
}


def _counter(function: Any, what: str, counts: Counter[str]) -> Callable[..., Any]:
    def called(*args: Any) -> Any:
        with LOCK:
            counts[what] += 1
        return function(*args)

    return called


def _named_rows(given: Any) -> Any:
    """Return tuples of arrays with attributes for columns, as compiled functions have them."""
    if isinstance(given, tuple):
        return tuple(_named_rows(item) for item in given)
    if isinstance(given, np.ndarray) and given.dtype.names:
        return given.view(np.recarray)
    return given


def _quietly(function: Any) -> Callable[..., Any]:
    """Let a function divide by zero without a warning, as compiled ones do."""

    def called(*args: Any) -> Any:
        with np.errstate(all="ignore"):
            return function(*(_named_rows(argument) for argument in args))

    return called
