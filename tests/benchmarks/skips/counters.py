"""Counts what the solvers compute, where they call their kernels."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import fields, is_dataclass
from typing import Any
from unittest import mock

import numpy as np

from benchmarks.skips.scene import fresh
from tests.benchmarks.skips import free_motions
from vibroimpact_solvers import stability
from vibroimpact_solvers.arrays import Described
from vibroimpact_solvers.impact_modes.modal import ModalFamily
from vibroimpact_solvers.kernels import bands, families, path_check, response
from vibroimpact_solvers.matrices import SymmetricMatrix
from vibroimpact_solvers.receptance import TriangleWaveResponse
from vibroimpact_solvers.slow_flow import MODELS
from vibroimpact_solvers.spectrum import Spectrum, methods
from vibroimpact_solvers.time_history import rigid_motions, soft, structure

Tally = Iterator[tuple[str, int]]
"""What one call computes: names and numbers."""


def _spectrum(_: Any, *args: Any) -> Tally:
    yield "natural modes", args[0].n


def _rows(result: Any, *_: Any) -> Tally:
    yield "entries of modes", result.size


def _scalar(_: Any, roots: Any, rests: Any, weight2: Any, omega: Any, *rest: Any) -> Tally:
    yield "responses of modes", roots.size * omega.size


def _amplitudes(_: Any, roots: Any, rests: Any, row: Any, omega: Any, *rest: Any) -> Tally:
    yield "responses of modes", roots.size * omega.size


def _bordered(_: Any, modes: Any, system: Any, omega: Any, *rest: Any) -> Tally:
    parities = (system.antisymmetric.shape[0] > 0) + (system.symmetric.shape[0] > 0)
    yield "responses of modes", parities * modes.roots.size * omega.size
    yield "impulses by equations", system.walls.size * omega.size


def _path_checks(_: Any, motions: Any, limits: Any, *rest: Any) -> Tally:
    yield "certified path checks", motions.omega.size * limits.lower.size


def _modal(_: Any, family: Any, motion: Any, tau: Any, dofs: Any) -> Tally:
    yield "displacements", motion.omega.size * tau.size * dofs.size


def _direct(_: Any, receptance: Any, omega: Any, p: Any, tau: Any, rows: Any, *rest: Any) -> Tally:
    chosen = rows(np.zeros((receptance.system.n, 1))).shape[0]
    yield "displacements", omega.size * tau.size * chosen


def _factors(_: Any, matrix: Any, **given: Any) -> Tally:
    yield "factorizations", 1


def _products(_: Any, matrix: Any, other: Any) -> Tally:
    yield "products of a matrix", 1 if other.ndim == 1 else other.shape[1]


def _maps(_: Any, orbits: Any) -> Tally:
    yield "maps of half periods", orbits.omega.size


def _survey(result: Any, *_: Any) -> Tally:
    yield "surveys of bands", 1
    yield "boxes", result.boxes


def _motions(_: Any, model: Any, variant: Any, t: Any, *, shapes: bool = True) -> Tally:
    yield "places of slow flows", t.size
    yield "shapes of slow flows", t.size if shapes else 0


def _structures(*_: Any) -> Tally:
    yield "structures prepared", 1


def _steps(_: Any, *args: Any) -> Tally:
    yield "steps between soft limiters", int(args[4]["steps"])


def _history(_: Any, structure: Any, motion: Any, work: Any, modal: Any, *rest: Any) -> Tally:
    written = int(motion[2]["written"].sum())  # since the progress was new
    _, _, (x, v, *_) = rest
    dofs = max(x.shape[-1], v.shape[-1])
    yield "displacements", written * dofs * ((x.size > 0) + (v.size > 0))


_COUNTED: tuple[tuple[Any, str, Callable[..., Tally]], ...] = (
    (methods, "_compute", _spectrum),
    (Spectrum, "rows", _rows),
    (response, "response_one", _scalar),
    (response, "amplitudes_one", _amplitudes),
    (families, "solutions", _bordered),
    (path_check, "check", _path_checks),
    (ModalFamily, "displacements", _modal),
    (TriangleWaveResponse, "displacements", _direct),
    (SymmetricMatrix, "factorize", _factors),
    (SymmetricMatrix, "__matmul__", _products),
    (stability, "growth", _maps),
    (bands, "survey", _survey),
    (structure, "without_contacts", _structures),
    (rigid_motions, "follow", _history),
    (soft, "follow", _steps),
    *((model, "motion", _motions) for model in MODELS.values()),
)


@contextmanager
def counting() -> Iterator[Counter[str]]:
    """Count, in the body of a with statement, from an empty cache of natural modes.

    Counted are: natural modes, and entries of the modal matrix; responses of one mode at one
    frequency; unknown impulses; path checks of one solution along one limit; displacements of one
    degree of freedom at one time; factorizations of matrices and products with one vector;
    maps of half periods; ranges surveyed for bands and boxes of frequency and time in them;
    places and shapes of slow flows at one time; structures prepared for motions; and what
    `free_motions.counted` counts.
    """
    counts: Counter[str] = Counter()
    with fresh(), ExitStack() as stack:
        stack.enter_context(free_motions.counted(counts))  # the calls of its loop are counted too
        for place, name, tally in _COUNTED:
            stack.enter_context(
                mock.patch.object(place, name, _counter(place, name, tally, counts))
            )
        yield counts
        for name in [name for name, number in counts.items() if not number]:
            del counts[name]


def _counter(
    place: Any, name: str, tally: Callable[..., Tally], counts: Counter[str]
) -> Callable[..., Any]:
    function = getattr(place, name)

    def counted(*args: Any, **named: Any) -> Any:
        result = function(*args, **named)
        with free_motions.LOCK:
            for what, number in tally(result, *args, **named):
                counts[what] += int(number)
        return result

    return counted


def numbers(result: Any) -> int:
    """Return how many numbers the arrays of a result hold."""
    if isinstance(result, Described):
        return sum(array.size for array in result.arrays.values())
    if not is_dataclass(result):
        return 0
    values = (getattr(result, field.name) for field in fields(result))
    return sum(value.size for value in values if isinstance(value, np.ndarray))


NUMBERS = "numbers of the result"


def counted(work: Callable[[], object]) -> Counter[str]:
    """Return what some work computes."""
    with counting() as counts:
        result = work()
    if held := numbers(result):
        counts[NUMBERS] = held
    return counts
