"""Hot kernels against plain loops of the same kind of work, in one run: a guard for CI.

The ratio of a kernel's time to that of its reference hardly depends on the machine, as both
are loops of the same compiler over the same numbers. One that grows by half means that the
kernel does more work or that its loop is no longer a vector loop.
"""

from __future__ import annotations

import math
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np

from benchmarks.cases import chain, grid
from benchmarks.tables import Goal, Table
from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.impact_modes import Problem
from vibroimpact_solvers.impact_modes.family import Family
from vibroimpact_solvers.impact_modes.modal import ModalFamily
from vibroimpact_solvers.impact_modes.solving import EXCESS
from vibroimpact_solvers.kernels import families, response
from vibroimpact_solvers.kernels.jit import fma, kernel

MARGIN: Final = 1.4
"""Times the usual ratio at which the guard fails; a slowdown of 1.5 is beyond it."""


@dataclass(frozen=True, slots=True)
class Watched:
    """A hot kernel: what runs it, its reference, and their usual ratio."""

    name: str
    work: Callable[[], object]
    reference: Callable[[], object]
    usual: float


@kernel
def _polynomials(x: Floats, y: Floats, terms: int) -> None:
    """Sum quotients of polynomials, as many as the kernel sums tangents: a vector loop."""
    for j in range(terms):
        shift = 1e-3 * j
        for i in range(x.size):
            z = x[i] * x[i] + shift
            top = fma(z, fma(z, fma(z, fma(z, fma(z, 0.1, 0.2), 0.3), 0.4), 0.5), 1.0)
            low = fma(z, fma(z, fma(z, fma(z, fma(z, 0.3, 0.1), 0.2), 0.3), 0.2), 2.0)
            y[i] = fma(top / low, x[i], y[i])


@kernel
def _sines(x: Floats, terms: int) -> float:
    """Sum sines and cosines of the mathematical library one after the other: no vector loop."""
    total = 0.0
    for j in range(terms):
        for i in range(x.size):
            total += math.sin(x[i] + j) * math.cos(x[i] - j)
    return total


def watched() -> tuple[Watched, ...]:
    """Return the hot kernels."""
    system = chain(100)
    natural = spectrum.spectrum(system)
    Omega = grid(0.2, 3.0, 1024)
    omega = Omega * (2.0 / np.pi)
    problem = Problem(system, omega, outputs=frozenset({"impulse"}), Omega=Omega)
    family = ModalFamily(problem, Family.of(problem), natural)
    at = problem.frequencies
    _, motion = family.members(at, with_motion=True)
    error = np.zeros(at.size)
    weights = family.rows[0] ** 2
    some = np.linspace(0.1, 0.9, 64)
    tau = np.linspace(0.0, 1.0, 16)
    # Numbers of terms are such that kernel and reference take about the same time.
    return (
        Watched(
            "impulse of one constraint",
            partial(response.response_one, family.roots, family.rests, weights, omega, at.rests),
            partial(_polynomials, some, np.zeros(64), 7000),
            0.8,
        ),
        Watched(
            "members with their motion",
            partial(family.members, at, with_motion=True),
            partial(_sines, some, 8_000),
            1.12,
        ),
        Watched(
            "walks along limits",
            partial(family.check, motion, error, problem, EXCESS),
            partial(_sines, some, 12_000),
            0.95,
        ),
        Watched(
            "displacements",
            partial(
                families.coordinates, family.roots, family.load, omega, motion.D, motion.U, tau
            ),
            partial(_sines, some, 12_000),
            1.12,
        ),
    )


def ratio(one: Watched, rounds: int = 11) -> float:
    """Return the kernel's time over that of its reference: least over least, in turns."""
    one.work()
    one.reference()
    work, reference = [], []
    for _ in range(rounds):
        work.append(_processor(one.work))
        reference.append(_processor(one.reference))
    return min(work) / min(reference)


def _processor(work: Callable[[], object]) -> float:
    start = time.process_time()
    for _ in range(3):
        work()
    return time.process_time() - start


def kernels() -> Table:
    """Time hot kernels over plain loops of the same kind; what a change must not raise."""
    rows: list[tuple[Any, ...]] = []
    for one in watched():
        found = statistics.median(ratio(one) for _ in range(3))
        rows.append((one.name, found, one.usual, one.usual * MARGIN))
    return Table(
        "Hot kernels over reference loops",
        ("kernel", "time over reference", "usually", "at most"),
        rows,
        f"The guard of the continuous integration fails above {MARGIN} times the usual ratio.",
        Goal("time over reference", "at most"),
    )


def main() -> int:
    """Fail where a kernel is too slow in each of three attempts."""
    slow = []
    for one in watched():
        limit, found = one.usual * MARGIN, []
        for _ in range(3):
            found.append(ratio(one))
            if found[-1] <= limit:
                break
        print(f"{one.name}: {min(found):.3f} of its reference, at most {limit:.3f}")
        if min(found) > limit:
            slow.append(one.name)
    return 1 if slow else 0


TABLES: Final = (kernels,)

if __name__ == "__main__":
    sys.exit(main())
