"""Random motions with stops of finite stiffness, and what their results state."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.reference.balls import UndecidedError
from tests.reference.rigid import History
from tests.reference.stopped import Stop, StoppedHistory, StoppedMotion
from tests.truth import histories, structures
from tests.truth.structures import Document
from tests.truth.verdicts import Case, Report, stated_error
from vibroimpact_solvers import time_history
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.laws import Linear
from vibroimpact_solvers.model import System

MAKERS = (
    "plain", "damped", "coupled", "loaded", "pressed", "grazing", "small_gaps", "sampled", "free",
    "large",
)  # fmt: skip
_COLUMNS = ("start", "stop", "impulse", "peak_force", "indentation", "energy_lost")
_SHORT = 1e-7  # of the longest phase, below which phases are grazings that rounding may decide
_LATE = 1e-6  # of the time, by which phases may be early or late


def case(rng: np.random.Generator) -> Case:
    """Return a random motion."""
    name = str(rng.choice(MAKERS))
    document = _large(rng) if name == "large" else histories.MAKERS[name](rng)
    fast = histories.top_frequency(document)
    M = np.array(document["M"])
    decades = 8.0 if rng.random() < 0.3 else 3.0
    for c in document["constraints"]:
        w = structures.row(document, c)
        mass = 1.0 / float(w @ np.linalg.solve(M, w))
        c["stiffness"] = float(10.0 ** rng.uniform(0.0, decades) * fast**2 * mass)
        ratio = 0.0 if rng.random() < 0.3 else float(10.0 ** rng.uniform(-3.0, -0.3))
        c["damping"] = 2.0 * ratio * float(np.sqrt(c["stiffness"] * mass))
        if rng.random() < 0.2:  # preloaded
            wall = "upper" if c["upper"] is not None else "lower"
            size = float(rng.uniform(0.0, 0.5))
            if None in (c["lower"], c["upper"]):
                c[wall] = -size * c[wall]
            else:
                c[wall] = -size * min(c["lower"], c["upper"])
    T = float(10.0 ** rng.uniform(0.0, 1.3)) * 2.0 / fast
    T = min([T, *(term[1][-1] for term in document.get("sampled", ()))])
    document["t"] = np.sort(rng.uniform(0.0, T, int(rng.choice([1, 3, 10])))).tolist()
    document["t_end"] = T
    if rng.random() < 0.3:
        _in_units(document, *(10.0 ** rng.uniform(-9.0, 9.0, 2)).tolist())
    return Case(name, document)


def _in_units(document: Document, length: float, mass: float) -> None:
    """Let a motion have other units of length and of mass, those of time unchanged."""
    for key, unit in (
        ("M", mass), ("K", mass), ("C", mass), ("x", length), ("v", length),
        ("force", mass * length),
    ):  # fmt: skip
        if document.get(key) is not None:
            document[key] = (np.array(document[key]) * unit).tolist()
    for c in document["constraints"]:
        for key in ("lower", "upper"):
            c[key] = None if c[key] is None else c[key] * length
        for key in ("stiffness", "damping"):
            c[key] *= mass
    push = mass * length
    document["load"] = [(a, f * push, *rest) for a, f, *rest in document.get("load", ())]
    document["sampled"] = [
        (shape, times, (np.array(values) * push).tolist())
        for shape, times, values in document.get("sampled", ())
    ]


def _large(rng: np.random.Generator) -> Document:
    """Return a chain of up to twenty masses, with damping."""
    n = int(rng.integers(5, 21))
    K = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    document: Document = {"M": np.diag(rng.uniform(0.5, 2.0, n)).tolist(), "K": K.tolist()}
    document["C"] = (K * float(10.0 ** rng.uniform(-3.0, -0.7))).tolist()
    document["constraints"] = structures.constraints(rng, n)
    document["x"] = [0.0] * n
    document["v"] = (rng.normal(size=n) * 2.0).tolist()
    return document


def system(document: Document) -> System:
    """Return the solvers' structure."""
    return structures.system(document, lambda c: Linear(c["stiffness"], c["damping"]))


def truth(document: Document) -> StoppedHistory:
    """Return the motion of the reference."""
    stops = [
        Stop(structures.row(document, c), c["lower"], c["upper"], c["stiffness"], c["damping"])
        for c in document["constraints"]
    ]
    motion = StoppedMotion(structures.reference(document), stops, document["x"], document["v"])
    return motion.run(document["t_end"], document["t"])


def check(case: Case, report: Report) -> None:
    """Compare the motion of a case with its reference."""
    document = case.document
    load = (
        *(time_history.Harmonic(*term) for term in document.get("load", ())),
        *(time_history.Sampled(*map(np.array, term)) for term in document.get("sampled", ())),
    )
    problem = time_history.Problem(
        system(document),
        time_history.State(np.array(document["x"]), np.array(document["v"])),
        document["t_end"],
        t=np.array(document["t"]),
        outputs=frozenset({"x", "v", "a", "energy", "force", "contacts"}),
        load=load,
    )
    plan = time_history.plan(problem)
    report.work(plan)
    try:
        result = time_history.solve(problem, plan)
    except ConvergenceError as error:
        report.fail("refused", str(error))
        return
    report.phase("reference")
    try:
        motion = truth(document)
    except UndecidedError as error:
        report.count(f"undecided: {error}")
        return
    histories.compare_states(
        case, result, History(states=motion.states, rates=motion.rates), report
    )
    _forces(result, motion, document, report)
    _contacts(result, motion, document["t_end"], report)


def _forces(
    result: time_history.Result, motion: StoppedHistory, document: Document, report: Report
) -> None:
    assert result.force is not None
    known = int((np.array(document["t"]) < result.error_predictable_until).sum())
    true = [force for forces in motion.forces[:known] for force in forces]
    stated, errors = result.force[:known], stated_error(result, "force")[:known]
    report.compare("force", stated.ravel(), true, errors.ravel())


def _contacts(
    result: time_history.Result, motion: StoppedHistory, t_end: float, report: Report
) -> None:
    """Compare the phases of contact before the horizon, one by one."""
    assert result.contact_start is not None
    assert result.contact_stop is not None
    until = min(t_end * (1.0 + _LATE), result.error_predictable_until - _LATE * t_end)
    if result.error_predictable_until >= t_end:
        until = t_end * (1.0 + _LATE)
    lengths = [float(c.stop - c.start) for c in motion.contacts]
    short = _SHORT * max([*lengths, t_end * 1e-6])
    true = [c for c, d in zip(motion.contacts, lengths, strict=True) if d > short]
    true = sorted((c for c in true if float(c.stop) < until), key=_key)
    assert result.contact_constraint is not None
    assert result.contact_side is not None
    columns = zip(
        result.contact_start.tolist(), result.contact_stop.tolist(),
        result.contact_constraint.tolist(), result.contact_side.tolist(), strict=True,
    )  # fmt: skip
    rows = [(a, side, start, k) for k, (start, stop, a, side) in enumerate(columns)
            if stop - start > short and stop < until]  # fmt: skip
    rows.sort()
    if [row[:2] for row in rows] != [_key(c)[:2] for c in true] or any(
        abs(row[2] - float(c.start)) > _LATE * t_end for row, c in zip(rows, true, strict=True)
    ):
        stated = [row[:3] for row in rows]
        message = f"{stated}, in truth {[_key(c) for c in true]} before {until!r} of {t_end!r}"
        report.fail("contacts", message[:600])
        return
    index = [row[3] for row in rows]
    for name in _COLUMNS if index else ():
        values = getattr(result, f"contact_{name}")[index]
        errors = np.asarray(stated_error(result, f"contact_{name}"))[index]
        report.compare(f"contact {name}", values, [getattr(c, name) for c in true], errors)


def _key(phase: Any) -> tuple[int, int, float]:
    return phase.constraint, phase.side, float(phase.start)
