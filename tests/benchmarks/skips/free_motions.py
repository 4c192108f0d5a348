"""The loop of time histories with its inner calls counted, or with what it leaves out put back.

The loop is compiled as one piece, so that nothing in it can be replaced at run time. To be
counted it is run by Python's interpreter, which takes the same path with the same numbers: the
functions that it calls for each watched coordinate and for each state are compiled ones.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from inspect import signature
from threading import Lock
from typing import Any, Final
from unittest import mock

import numpy as np

from vibroimpact_solvers.kernels import free_motion, whole_motion
from vibroimpact_solvers.time_history import run, single_call

_COUNTED: Final = {
    "derivatives": "coordinates expanded",
    "near_derivatives": "coordinates expanded",
    "take": "states advanced",
}
"""What is counted when the loop calls a function of `kernels.flow`."""

LOCK: Final = Lock()
"""Held while numbers are counted: several threads may."""


@contextmanager
def counted(counts: Counter[str]) -> Iterator[None]:
    """Count in the loop: expansions of one coordinate, and states taken to another time."""
    with ExitStack() as stack:
        for name, what in _COUNTED.items():
            function = _counter(getattr(free_motion, name), what, counts)
            stack.enter_context(mock.patch.object(free_motion, name, function))
        for name in _loops():
            plain = getattr(free_motion, name).py_func
            stack.enter_context(mock.patch.object(free_motion, name, plain))
        loop = _quietly(free_motion.advance)
        stack.enter_context(mock.patch.object(whole_motion, "advance", loop))
        stack.enter_context(mock.patch.object(run, "advance", loop))
        plain = vars(whole_motion)["whole_motion"].py_func
        stack.enter_context(mock.patch.object(single_call, "whole_motion", plain))
        yield


@contextmanager
def watching_all() -> Iterator[None]:
    """Let the loop search all walls in every free motion, those that are out of reach included.

    Only inside `counted`, which lets Python's interpreter run the loop.
    """
    search = vars(free_motion)["_next_event"]
    place = list(signature(search).parameters).index("out_of_reach")

    def awake(*args: Any) -> Any:
        args[place][:] = False
        return search(*args)

    with mock.patch.object(free_motion, "_next_event", awake):
        yield


def _counter(function: Any, what: str, counts: Counter[str]) -> Callable[..., Any]:
    def called(*args: Any) -> Any:
        with LOCK:
            counts[what] += 1
        return function(*args)

    return called


def _quietly(function: Any) -> Callable[..., Any]:
    """Let a function divide by zero without a warning, as compiled ones do."""

    def called(*args: Any) -> Any:
        with np.errstate(all="ignore"):
            return function(*args)

    return called


def _loops() -> list[str]:
    """Return the functions that have to be run by the interpreter: all that call counted ones."""
    own = {
        name: set(value.py_func.__code__.co_names)
        for name, value in vars(free_motion).items()
        if getattr(value, "py_func", None) is not None and value.__module__ == free_motion.__name__
    }
    names, known = set[str](), set(_COUNTED)
    while more := {name for name, called in own.items() if called & known} - names:
        names |= more
        known |= more
    return sorted(names)
