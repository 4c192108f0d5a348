"""Counts what the solvers compute, where they call their kernels."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any
from unittest import mock

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.impact_modes.modal import ModalFamily
from vibroimpact_solvers.kernels import families, limits, response
from vibroimpact_solvers.matrices import SymmetricMatrix
from vibroimpact_solvers.receptance import Receptance
from vibroimpact_solvers.slow_flow.restitution import Restitution
from vibroimpact_solvers.spectrum import Cache, methods


def _spectrum(*args: Any) -> tuple[str, int]:
    return "natural modes", args[0].n


def _scalar(roots: Any, rests: Any, weight2: Any, omega: Any, *_: Any) -> tuple[str, int]:
    return "responses of modes", roots.size * omega.size


def _bordered(roots: Any, rests: Any, odd: Any, even: Any, *rest: Any) -> tuple[str, int]:
    parities = (odd.shape[0] > 0) + (even.shape[0] > 0)
    return "responses of modes", parities * roots.size * rest[2].size


def _walks(*args: Any) -> tuple[str, int]:
    return "walks along a limit", args[2].size * args[5].shape[0]


def _modal(family: Any, motion: Any, tau: Any, dofs: Any) -> tuple[str, int]:
    return "displacements", motion.omega.size * tau.size * dofs.size


def _direct(receptance: Any, omega: Any, p: Any, tau: Any, rows: Any, depth: Any) -> Any:
    import numpy as np

    chosen = rows(np.zeros((receptance.system.n, 1))).shape[0]
    return "displacements", omega.size * tau.size * chosen


def _factors(matrix: Any) -> tuple[str, int]:
    return "factorizations", 1


def _motions(model: Any, variant: Any, t: Any, **_: Any) -> tuple[str, int]:
    return "places of slow flows", t.size


_COUNTED: tuple[tuple[Any, str, Callable[..., tuple[str, int]]], ...] = (
    (methods, "_compute", _spectrum),
    (response, "response_one", _scalar),
    (families, "members", _bordered),
    (limits, "check", _walks),
    (ModalFamily, "displacements", _modal),
    (Receptance, "displacements", _direct),
    (SymmetricMatrix, "factorize", _factors),
    (Restitution, "motion", _motions),
)


def forget_modes() -> None:
    """Empty the cache of natural modes; only inside `counting`, which has its own."""
    vars(methods)["CACHE"] = Cache(2**30)


@contextmanager
def counting() -> Iterator[Counter[str]]:
    """Count, in the body of a with statement, from an empty cache of natural modes.

    Counted are: natural modes found, responses of one mode at one frequency, walks of one
    member along one limit, and displacements of one degree of freedom at one time.
    """
    counts: Counter[str] = Counter()
    spectrum.CACHE.clear()
    with mock.patch.object(methods, "CACHE", Cache(2**30)):
        patches = [mock.patch.object(*_counter(*entry, counts)) for entry in _COUNTED]
        for patch in patches:
            patch.start()
        try:
            yield counts
        finally:
            for patch in patches:
                patch.stop()


def _counter(
    place: Any, name: str, count: Callable[..., tuple[str, int]], counts: Counter[str]
) -> tuple[Any, str, Any]:
    function = getattr(place, name)

    def counted(*args: Any, **named: Any) -> Any:
        what, number = count(*args, **named)
        counts[what] += number
        return function(*args, **named)

    return place, name, counted
