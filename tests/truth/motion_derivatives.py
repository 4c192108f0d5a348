"""Random derivatives of motions with impacts, and what their results state against what is true.

The numbers of a motion are rounded to a few bits, so that small changes of them are exact; the
truth is the difference of four motions of the independent reference, to 77 digits.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from flint import arb, arb_mat

from tests.reference.balls import UndecidedError
from tests.reference.rigid import History
from tests.truth import histories
from tests.truth.structures import Document
from vibroimpact_solvers import time_history
from vibroimpact_solvers.derivatives import LoadRate, MatrixRate, Parameter, StopRate
from vibroimpact_solvers.errors import SolverError
from vibroimpact_solvers.model import SymmetricMatrix

_BITS, _STEP = 21, 2.0**-27  # of the numbers; of the change, relative
_TINY = 2.0**-180
_ZERO = 1e-30  # what differences leave of zero

Change = Callable[[Document, float], None]
"""Changes a document by a part of the parameter, times a step."""


def rounded(values: Any) -> Any:
    """Return numbers with few bits."""
    fractions, exponents = np.frexp(np.asarray(values, dtype=np.float64))
    return np.ldexp(np.round(np.ldexp(fractions, _BITS)), exponents - _BITS)


def case(rng: np.random.Generator) -> Document:
    """Return a random motion, and output times."""
    makers = histories.plain, histories.damped, histories.coupled, histories.loaded
    document = makers[int(rng.integers(4))](rng)
    top = histories.top_frequency(document)
    for name in ("M", "K", "C", "force", "x", "v", "load"):
        if document.get(name):
            document[name] = rounded(document[name]).tolist()
    document["load"] = [[int(dof), *term] for dof, *term in document.get("load", ())]
    for c in document["constraints"]:
        for name in ("lower", "upper", "restitution"):
            c[name] = None if c[name] is None else float(rounded(c[name]))
        c["weights"] = rounded(c["weights"]).tolist()
    T = document["t_end"] = float(rng.uniform(2.0, 30.0) / top)
    document["t"] = np.sort(rng.uniform(0.0, T, 6)).tolist()
    return document


def parameters(
    rng: np.random.Generator, document: Document
) -> list[tuple[Parameter, Change, float]]:
    """Return parameters of all sorts, how the document changes by each, and steps."""
    n, found = len(document["M"]), list[tuple[Parameter, Change, float]]()

    def add(parameter: Parameter, change: Change, of: float) -> None:
        found.append((parameter, change, _STEP * 2.0 ** math.frexp(of or 1.0)[1]))

    place = int(rng.integers(len(document["constraints"])))
    stop = document["constraints"][place]
    for side in ("lower", "upper"):
        if stop[side] is not None:
            rate = StopRate(place, **{side: 1.0})
            add(Parameter(side, stops=(rate,)), _at(("constraints", place, side)), stop[side])
    # At zero the derivative is that of a coefficient that grows: there are no motions below.
    if stop["restitution"] > 0.0:
        add(
        Parameter("restitution", stops=(StopRate(place, restitution=1.0),)),
        _at(("constraints", place, "restitution")), stop["restitution"],
      )  # fmt: skip
    weight = StopRate(place, weights=((stop["dofs"][0], 1.0),))
    add(Parameter("weight", stops=(weight,)), _at(("constraints", place, "weights", 0)), 1.0)
    for name in "MKC":
        if document.get(name) is None:
            continue
        add(Parameter(f"{name}.scale", **{name: MatrixRate(1.0)}), _scaled(name), 1.0)
        i, j = (int(k) for k in rng.integers(n, size=2))
        entry = np.zeros((n, n))
        entry[i, j] = entry[j, i] = 1.0
        one = MatrixRate(entries=SymmetricMatrix.dense(entry))
        add(Parameter(f"{name}.entry", **{name: one}), _entry(name, i, j), document[name][i][i])
    dof = int(rng.integers(n))
    unit = np.eye(n)[dof]
    add(Parameter("x", x=unit), _at(("x", dof)), document["x"][dof])
    add(Parameter("v", v=unit), _at(("v", dof)), document["v"][dof])
    if document.get("force"):
        add(Parameter("force", force=unit), _at(("force", dof)), document["force"][dof])
    for k, (of, A, w, phase) in enumerate(document["load"]):
        c, s = math.cos(phase), math.sin(phase)
        for name, rate, value in (
            ("amplitude", LoadRate(of, w, c, s), A),
            ("frequency", LoadRate(of, w, cosine=-A * s, sine=A * c), w),
            ("phase", LoadRate(of, w, -A * s, A * c), phase),
        ):
            where = 1 + ("amplitude", "frequency", "phase").index(name)
            add(Parameter(f"{name}{k}", loads=(rate,)), _at(("load", k, where)), value)
    return found


def _at(path: tuple[Any, ...]) -> Change:
    def change(document: Document, by: float) -> None:
        here: Any = document
        for part in path[:-1]:
            here = here[part]
        here[path[-1]] += by

    return change


def _scaled(name: str) -> Change:
    def change(document: Document, by: float) -> None:
        document[name] = (np.array(document[name]) * (1.0 + by)).tolist()

    return change


def _entry(name: str, i: int, j: int) -> Change:
    def change(document: Document, by: float) -> None:
        document[name][i][j] += by
        if i != j:
            document[name][j][i] += by

    return change


def _numbers(document: Document, motion: History) -> tuple[list[tuple[int, int]], list[Any]]:
    """Return which walls are struck, and the numbers that are differentiated."""
    n = len(document["M"])
    M, K = arb_mat(document["M"]), arb_mat(document["K"])
    numbers = list[Any]()
    for z, rate in zip(motion.states, motion.rates, strict=True):
        x, v = (arb_mat([[z[k + i, 0]] for i in range(n)]) for k in (0, n))
        a = [rate[n + i, 0] for i in range(n)]
        energy = (v.transpose() * M * v)[0, 0] / 2 + (x.transpose() * K * x)[0, 0] / 2
        if document.get("force"):
            energy -= (arb_mat([document["force"]]) * x)[0, 0]
        numbers += [*(x[i, 0] for i in range(n)), *(v[i, 0] for i in range(n)), *a, energy]
    for impact in motion.impacts:
        numbers += [impact.time, impact.velocity, impact.impulse]
    return [(i.constraint, i.side) for i in motion.impacts], [number.mid() for number in numbers]


def true(document: Document, change: Change, step: float) -> tuple[Any, Any] | None:
    """Return derivatives and bounds of their errors; None where impacts come or go."""
    found = []
    for factor in (1.0, -1.0, 2.0, -2.0):
        other = copy.deepcopy(document)
        change(other, factor * step)
        motion = histories.truth(other)
        if motion.contacts:
            return None
        found.append(_numbers(other, motion))
    if any(struck != found[0][0] for struck, _ in found):
        return None
    h = arb(step)
    near = [(a - b) / (2 * h) for a, b in zip(found[0][1], found[1][1], strict=True)]
    far = [(a - b) / (4 * h) for a, b in zip(found[2][1], found[3][1], strict=True)]
    best = np.array([float((4 * a - b) / 3) for a, b in zip(near, far, strict=True)])
    best[np.abs(best) < _ZERO * np.abs(best).max(initial=0.0)] = 0.0
    bent = np.array([float(a - b) for a, b in zip(near, far, strict=True)])
    # What two orders lack is what one lacks, to its square, about.
    size = float(np.abs(best).max(initial=_TINY))
    lacks = 10.0 * float(np.abs(bent).max(initial=0.0)) ** 2 / size + _TINY * size
    return best, np.full(best.size, lacks)


@dataclass(frozen=True)
class Compared:
    """One output of one motion, differentiated by one parameter."""

    seed: int
    parameter: str
    output: str
    size: float  # largest true derivative
    wrong: float  # largest difference from it
    over: float  # stated over true error, the median of its numbers
    within: bool  # whether all differences are within the stated errors


def compared(seed: int, most: int = 4) -> tuple[list[Compared], int]:
    """Return a random motion's derivatives beside the truth, and how many numbers have none."""
    rng = np.random.default_rng(seed)
    document = case(rng)
    every = parameters(rng, document)
    some = [every[k] for k in rng.permutation(len(every))[:most]]
    try:
        problem = histories.problem_of(document, parameters=tuple(p for p, *_ in some))
        result = time_history.solve(problem, time_history.plan(problem))
    except SolverError:
        return [], 0
    assert result.derivative_reason is not None
    assert result.derivative_impact_reason is not None
    given = result.derivative_reason == 0, result.derivative_impact_reason == 0
    none = int((~given[0]).sum() + (~given[1]).sum())
    if not given[0].any():
        return [], none
    found = list[Compared]()
    for place, (parameter, change, step) in enumerate(some):
        try:
            answer = true(document, change, step)
        except UndecidedError:
            continue
        if answer is None:
            continue
        found += _each(seed, result, place, parameter.path, *answer)
    return found, none


def _each(seed: int, result: Any, place: int, path: str, best: Any, lacks: Any) -> list[Compared]:
    times, impacts = result.t.size, result.impact_time.size
    n = result.dof.size
    samples, struck = np.split(best, [times * (3 * n + 1)])
    if struck.size != 3 * impacts:
        return []
    samples, struck = samples.reshape(times, 3 * n + 1), struck.reshape(impacts, 3)
    truths = {
        "x": samples[:, :n], "v": samples[:, n : 2 * n], "a": samples[:, 2 * n : 3 * n],
        "energy": samples[:, 3 * n],
        "impact_time": struck[:, 0], "impact_velocity": struck[:, 1],
        "impact_impulse": struck[:, 2],
    }  # fmt: skip
    found = []
    for name, right in truths.items():
        value = getattr(result, f"derivative_{name}")[..., place]
        error = getattr(result, f"derivative_{name}_error")[..., place]
        known = np.isfinite(value)
        if not known.any():
            continue
        wrong, right, error = (each[known] for each in (np.abs(value - right), right, error))
        slack = lacks[0] + 2.0**-52 * np.abs(right)
        over = np.median(error / np.maximum(wrong, 2.0**-53 * np.abs(right) + 1e-300))
        found.append(
            Compared(
                seed,
                path,
                name,
                float(np.abs(right).max()),
                float(wrong.max()),
                float(over),
                bool((wrong <= error + slack).all()),
            )
        )
    return found


def main(first: int, last: int) -> None:
    """Print what the derivatives of some seeds state against what is true."""
    pairs = [compared(seed) for seed in range(first, last)]
    found = [one for each, _ in pairs for one in each if one.size]
    relative = np.array([one.wrong / one.size for one in found])
    outside = [one for one in found if not one.within]
    print(f"{len(found)} outputs of {sum(bool(each) for each, _ in pairs)} motions")
    print(f"{sum(none for _, none in pairs)} numbers without derivatives")
    print("relative errors", np.quantile(relative, [0.5, 0.9, 0.99, 1.0]))
    print("stated/true", np.median([one.over for one in found]))
    print(f"{(relative > 1e-10).mean():.2%} above 1e-10, {len(outside)} outside")
    for one in outside:
        print(one)


if __name__ == "__main__":
    import sys

    main(int(sys.argv[1]), int(sys.argv[2]))
