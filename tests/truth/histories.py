"""Random motions between rigid limiters, and what their results state against what is true."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from flint import arb

from tests.reference.balls import UndecidedError
from tests.reference.rigid import Contact, History, RigidMotion
from tests.truth import structures
from tests.truth.structures import Document
from tests.truth.verdicts import ROUNDING, Case, Report, stated_error
from vibroimpact_solvers import time_history
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import ConvergenceError, ModelError, PlanError

_REFERENCE = 2.0**-230  # its own roundings, relative to the motion


def plain(rng: np.random.Generator) -> Document:
    """Return a structure of some kind with limiters, and a state inside."""
    kind = str(rng.choice(["dense", "diagonal", "chain", "mirror", "free", "indefinite"]))
    document = structures.structure(rng, kind, 4)
    if len(document["M"]) > 4:
        document = structures.structure(rng, "diagonal", 4)
    n = len(document["M"])
    document["constraints"] = structures.constraints(rng, n)
    _restitution(rng, document)
    scale = min(w for c in document["constraints"] for w in (c["lower"], c["upper"]) if w)
    document["x"] = (rng.uniform(-0.2, 0.2, n) * scale).tolist()
    document["v"] = (rng.normal(size=n) * scale * top_frequency(document) * 0.7).tolist()
    return document


def _restitution(rng: np.random.Generator, document: Document) -> None:
    for c in document["constraints"]:
        c["restitution"] = float(
            1.0 if rng.random() < 0.45 else (0.0 if rng.random() < 0.15 else rng.uniform(0.2, 0.98))
        )


def top_frequency(document: Document) -> float:
    values = np.linalg.eigvals(np.linalg.solve(document["M"], document["K"]))
    top = float(np.sqrt(np.abs(values).max()))
    return top if top > 1e-6 else 1.0


def damped(rng: np.random.Generator) -> Document:
    """Add damping that does not couple the modes."""
    document = plain(rng)
    M, K = np.array(document["M"]), np.array(document["K"])
    a, b = rng.uniform(0.0, 0.3, 2) * (rng.random(2) < 0.7)
    document["C"] = (a * M + b * K).tolist()
    return document


def coupled(rng: np.random.Generator) -> Document:
    """Add damping that couples the modes."""
    document = plain(rng)
    n = len(document["M"])
    C = np.zeros((n, n))
    for _ in range(int(rng.integers(1, n + 1))):
        w = np.eye(n)[int(rng.integers(n))]
        if n > 1 and rng.random() < 0.5:
            w = w - np.eye(n)[int(rng.integers(n))]
        C += np.outer(w, w) * 10.0 ** rng.uniform(-3, 0.5)
    document["C"] = C.tolist()
    return document


def loaded(rng: np.random.Generator) -> Document:
    """Add loads, constant and harmonic, in resonance too."""
    document = (plain, damped, coupled)[int(rng.integers(3))](rng)
    n, fastest = len(document["M"]), top_frequency(document)
    size = fastest**2 * float(np.diag(document["M"]).mean())
    if rng.random() < 0.6:
        document["force"] = (rng.normal(size=n) * size * 0.3).tolist()
    load = []
    for _ in range(int(rng.integers(0, 3))):
        frequency = float(fastest * rng.uniform(0.1, 2.0))
        if rng.random() < 0.3:
            values = np.abs(np.linalg.eigvals(np.linalg.solve(document["M"], document["K"])))
            frequency = float(np.sqrt(rng.choice(values))) or frequency
        amplitude, phase = float(rng.normal() * size * 0.3), float(rng.uniform(-3, 3))
        load.append([int(rng.integers(n)), amplitude, frequency, phase])
    document["load"] = load
    return document


def pressed(rng: np.random.Generator) -> Document:
    """Start at a wall: at rest, receding, or towards it; with a force."""
    document = loaded(rng)
    n = len(document["M"])
    c = document["constraints"][0]
    c.update(dofs=[c["dofs"][0]], weights=[1.0])
    document["constraints"] = [c] + [
        other for other in document["constraints"][1:] if len(other["dofs"]) == 1
        and other["dofs"] != c["dofs"]
    ]  # fmt: skip
    side = 1 if c["upper"] is not None else -1
    x = np.zeros(n)
    x[c["dofs"][0]] = c["upper"] if side > 0 else -c["lower"]
    document["x"] = x.tolist()
    v = np.array(document["v"])
    choice = rng.random()
    v[c["dofs"][0]] = 0.0 if choice < 0.5 else side * rng.normal() * 10.0 ** rng.uniform(-9, 0)
    document["v"] = (v * (0.0 if rng.random() < 0.3 else 1.0)).tolist()
    if rng.random() < 0.6:
        force = np.array(document.get("force") or np.zeros(n))
        force[c["dofs"][0]] += side * abs(rng.normal()) * np.diag(document["M"]).mean() * 2.0
        document["force"] = force.tolist()
    return document


def grazing(rng: np.random.Generator) -> Document:
    """Start so that the first turning point is at a wall, nearly."""
    document = (plain, damped, loaded)[int(rng.integers(3))](rng)
    reference = RigidMotion(
        structures.reference(document), (), (), document["x"], document["v"]
    )  # fmt: skip
    T = 6.0 / top_frequency(document)
    states = reference.run(T, np.linspace(0, T, 200)[:-1].tolist()).states
    n = len(document["M"])
    x = np.array([[float(z[i, 0]) for i in range(n)] for z in states])
    c = document["constraints"][0]
    y = x @ structures.row(document, c)
    k = int(np.argmax(np.abs(y)))
    if 0 < k < len(y) - 1:
        below, mid, above = y[k - 1 : k + 2]
        bend = below - 2 * mid + above
        top = abs(mid - (above - below) ** 2 / (8 * bend)) if bend else abs(mid)
    else:
        top = abs(y[k])
    gap = float(top * (1.0 + rng.choice([-1, 1]) * 10.0 ** rng.uniform(-16, -2)))
    if gap > 1e-3:
        c.update(lower=gap, upper=gap)
    return document


def small_gaps(rng: np.random.Generator) -> Document:
    """Let gaps be small against the motion."""
    document = (plain, damped, loaded)[int(rng.integers(3))](rng)
    for c in document["constraints"]:
        small = 10.0 ** rng.uniform(-4, -1)
        for wall in ("lower", "upper"):
            if c[wall] is not None:
                c[wall] = float(c[wall] * small)
    document["x"] = [0.0] * len(document["M"])
    return document


def sampled(rng: np.random.Generator) -> Document:
    """Add loads that are straight lines between samples, and moving bases."""
    document = (plain, damped, coupled, free)[int(rng.integers(4))](rng)
    n, fastest = len(document["M"]), top_frequency(document)
    M, terms = np.array(document["M"]), []
    for _ in range(int(rng.integers(1, 3))):
        direction = -M @ np.ones(n) if rng.random() < 0.4 else np.eye(n)[int(rng.integers(n))]
        t = np.cumsum(rng.uniform(0.05, 2.0, 60)) / fastest
        t = np.concatenate([[0.0], t]) if rng.random() < 0.5 else np.arange(61) / fastest
        values = rng.normal(size=t.size) * fastest**2 * float(rng.uniform(0.1, 1.0))
        terms.append([direction.tolist(), t.tolist(), values.tolist()])
    document["sampled"] = terms
    return document


def free(rng: np.random.Generator) -> Document:
    """Return bodies that hang on nothing."""
    n = int(rng.integers(1, 5))
    M = np.diag(rng.uniform(0.5, 2.0, n)) if rng.random() < 0.6 else np.eye(n) * 1.3
    K = np.zeros((n, n))
    if n > 1 and rng.random() < 0.8:
        a = rng.uniform(0.5, 2.0, n - 1)
        for i in range(n - 1):
            d = np.zeros(n)
            d[i], d[i + 1] = 1.0, -1.0
            K += a[i] * np.outer(d, d)
    document: Document = {"M": M.tolist(), "K": K.tolist()}
    document["constraints"] = structures.constraints(rng, n)
    _restitution(rng, document)
    if rng.random() < 0.5:
        document["force"] = (rng.normal(size=n) * 0.5).tolist()
    if rng.random() < 0.3:
        document["C"] = (K * 0.1 + (np.eye(n) * 0.1 if rng.random() < 0.5 else 0.0)).tolist()
    document["x"] = [0.0] * n
    document["v"] = rng.normal(size=n).tolist()
    return document


def simultaneous(rng: np.random.Generator) -> Document:
    """Strike two walls at the same time, or nearly."""
    n = int(rng.integers(2, 4))
    M = np.eye(n) if rng.random() < 0.5 else np.eye(n) + 0.3 * (np.ones((n, n)) - np.eye(n))
    K = (np.ones((n, n)) + np.eye(n) * 1.0) if rng.random() < 0.7 else np.zeros((n, n))
    k = float(rng.choice([0.0, 0.5, 0.8, 1.0]))
    document: Document = {"M": M.tolist(), "K": K.tolist()}
    document["constraints"] = [
        {"dofs": [i], "weights": [1.0], "lower": 1.0, "upper": 1.0, "restitution": k}
        for i in range(2)
    ]
    off = float(rng.choice([0.0, 10.0 ** rng.uniform(-16, -10)]))
    v = np.full(n, 2.5)
    v[1] += off
    document.update(x=[0.0] * n, v=v.tolist())
    if rng.random() < 0.4:
        document["force"] = [1.0] * n
    return document


MAKERS: dict[str, Callable[[np.random.Generator], Document]] = {
    maker.__name__: maker
    for maker in (
        plain, damped, coupled, loaded, pressed, grazing, small_gaps, sampled, free, simultaneous
    )
}  # fmt: skip


def case(rng: np.random.Generator) -> Case:
    """Return a random motion."""
    name = str(rng.choice(list(MAKERS)))
    document = MAKERS[name](rng)
    T = float(10.0 ** rng.uniform(0.0, 1.4)) * 2.0 / top_frequency(document)
    T = min([T, *(term[1][-1] for term in document.get("sampled", ()))])
    count = int(rng.choice([1, 3, 10]))
    document["t"] = np.sort(rng.uniform(0.0, T, count)).tolist()
    document["t_end"] = T
    return Case(name, document)


OUTPUTS = "x", "v", "a", "impacts", "contacts", "energy"
_WITHOUT = {"a"}  # what more digits and integrators do not give


def problem_of(document: Document, **more: Any) -> time_history.Problem:
    """Return the solvers' problem."""
    load = (
        *(time_history.Harmonic(*term) for term in document.get("load", ())),
        *(time_history.Sampled(*map(np.array, term)) for term in document.get("sampled", ())),
    )
    return time_history.Problem(
        structures.system(document),
        time_history.State(np.array(document["x"]), np.array(document["v"])),
        document["t_end"],
        t=np.array(document["t"]),
        outputs=frozenset(OUTPUTS) - (_WITHOUT if {"digits", "method"} & more.keys() else set()),
        load=load,
        **more,
    )


def truth(document: Document, until: float = math.inf) -> History:
    """Return the motion of the reference, as far as it is needed."""
    motion = RigidMotion(
        structures.reference(document),
        structures.limiters(document),
        [c["restitution"] for c in document["constraints"]],
        document["x"],
        document["v"],
    )
    return motion.run(min(document["t_end"], until), document["t"])


_LATE = 1e-5  # of the time, by which impacts may be early or late
_MANY = 5_000  # impacts, of at least two steps each: the reference gives up after 10,000 steps
REFUSALS = ("many more than planned",)
"""Part of the message of refusals that the documentation names."""


def check(
    case: Case,
    report: Report,
    expected: tuple[str, ...] = REFUSALS,
    found: Callable[[time_history.Result], None] = lambda result: None,
    **more: Any,
) -> None:
    """Compare the motion of a case with its reference; `expected` refusals are no failures.

    `found` is called with the result.
    """
    document = case.document
    try:
        problem = problem_of(document, **more)
    except ModelError as error:
        if error.code == "outside_limits":
            report.count("starts outside")
            return
        raise
    try:
        plan = time_history.plan(problem)
        report.work(plan)
        result = time_history.solve(problem, plan)
        found(result)
        refused, until = None, result.error_predictable_until
    except (ModelError, PlanError, ConvergenceError) as error:
        refused, until = error, math.inf
    except MemoryError:  # of tens of millions of impacts: that of a case is limited
        report.count("more impacts than fit into the memory of a case")
        return
    if refused is None and result.count_impacts > _MANY:
        report.count("more impacts than the reference can follow")
        return
    if refused is not None and any(words in str(refused) for words in expected):
        report.count(f"refused: {next(words for words in expected if words in str(refused))}")
        return
    report.phase("reference")
    try:
        # What comes after the horizon is not stated, and is the longer part of unstable motions.
        motion = truth(document, until)
    except UndecidedError as error:
        report.count(f"undecided: {error}")
        return
    if refused is not None:
        report.fail("refused", str(refused))
        return
    compare(case, result, motion, report)


def checked(document: Document) -> Report:
    """Check one motion, of which no number may be outside of its error."""
    report = Report()
    check(Case("", document), report)
    assert not report.failures
    return report


def compare(case: Case, result: time_history.Result, motion: History, report: Report) -> None:
    """Compare a result with the motion of the reference, up to its horizon."""
    compare_states(case, result, motion, report)
    _impacts(result, motion, result.error_predictable_until, report, case)
    _contacts(result, motion, case.document["t_end"], report)


def compare_states(
    case: Case, result: time_history.Result, motion: History, report: Report
) -> None:
    """Compare displacements and velocities at the output times before the horizon."""
    document, horizon = case.document, result.error_predictable_until
    n, t = len(document["M"]), np.array(document["t"])
    known = int(np.searchsorted(t, horizon, side="left")) if horizon < document["t_end"] else t.size
    report.count("horizon at the end" if horizon >= document["t_end"] else "horizon before")
    known = min(known, len(motion.states))
    if known:
        _states(case, result, motion.states[:known], report, n)
    if known and result.a is not None:
        true_a = [[rate[n + i, 0] for i in range(n)] for rate in motion.rates[:known]]
        largest = max(abs(a).upper() for row in true_a for a in row)
        flat = [a + arb(0, largest * arb(_REFERENCE)) for row in true_a for a in row]
        report.compare(
            "a", np.ravel(result.a[:known]), flat, np.ravel(stated_error(result, "a")[:known])
        )


def _states(
    case: Case, result: time_history.Result, states: list[Any], report: Report, n: int
) -> None:
    assert result.x is not None
    assert result.v is not None
    true_x = [[z[i, 0] for i in range(n)] for z in states]
    true_v = [[z[n + i, 0] for i in range(n)] for z in states]
    # The reference rounds its states at impacts: what rests moves by some 1e-77 of the motion.
    force = case.document.get("force") or ()
    start = map(arb, (*case.document["x"], *case.document["v"], *force))
    largest = max(abs(x).upper() for x in (*start, *(x for r in true_x + true_v for x in r)))
    for name, stated, true in (("x", result.x, true_x), ("v", result.v, true_v)):
        bounds = stated_error(result, name)[: len(states)]
        flat = [x + arb(0, largest * arb(_REFERENCE)) for r in true for x in r]
        report.compare(name, np.ravel(stated[: len(states)]), flat, np.ravel(bounds))


def _stiffness(document: Document) -> Floats:
    """Return the matrix of displacements in the norm of energy, positive definite."""
    values, vectors = np.linalg.eigh(np.array(document["K"]))
    floor = 0.01 * top_frequency(document) ** 2 * np.array(document["M"])
    return np.asarray((vectors * np.abs(values)) @ vectors.T + floor)


def _size(document: Document, states: Iterable[tuple[list[Any], list[Any]]]) -> float:
    """Return the largest state in the norm of energy, the initial one included."""
    M, stiff = np.array(document["M"]), _stiffness(document)
    size = 0.0
    for x, v in [(document["x"], document["v"]), *states]:
        place, rate = np.array(list(map(float, x))), np.array(list(map(float, v)))
        size = max(size, float(np.sqrt(place @ stiff @ place + rate @ M @ rate)))
    return size


def _unknown_impulse(
    result: time_history.Result, motion: History, horizon: float, document: Document
) -> float:
    """Return what the stated error of the state makes of an impulse before the horizon."""
    n = len(document["M"])
    before = [z for t, z in zip(document["t"], motion.states, strict=False) if t < horizon]
    size = _size(
        document,
        (([z[i, 0] for i in range(n)], [z[n + i, 0] for i in range(n)]) for z in before),
    )
    error = min(result.error_condition * ROUNDING, result.error_tolerance)
    rows = [structures.row(document, c) for c in document["constraints"]]
    M = np.array(document["M"])
    mass = max(1.0 / float(w @ np.linalg.solve(M, w)) for w in rows)
    return 2.0 * math.sqrt(mass) * error * size


def _clear_floor(impulses: list[float], unknown: float, size: float) -> float:
    """Return an impulse that none of some impulses is near: errors do not take them across."""
    floor = max(2.0 * unknown, 1e-6 * size)
    while any(abs(impulse - floor) <= unknown for impulse in impulses):
        floor += 2.0 * unknown
    return floor


def _clear_interval(near: float, *times: list[float]) -> float:
    """Return a time that no interval between some times is near: rounding takes none across."""
    intervals = np.concatenate([np.diff(np.sort(some)) for some in times])
    while (np.abs(intervals - near) <= 1e-3 * near).any():
        near *= 1.01
    return near


def _impacts(
    result: time_history.Result, motion: History, horizon: float, report: Report, case: Case
) -> None:
    """Compare the table of impacts, up to the first contact and the horizon.

    Impacts that follow one another within rounding are compared by the sums of their impulses.
    Those that are smaller than the error of the state may be there or not.
    """
    assert result.impact_time is not None
    assert result.impact_constraint is not None
    assert result.impact_side is not None
    assert result.impact_impulse is not None
    t_end = case.document["t_end"]
    starts = [] if result.contact_start is None else result.contact_start.tolist()
    # A chatter is summed by the solver before the reference does.
    stop = min([horizon, t_end, *starts, *(_chatter_start(motion, c) for c in motion.contacts)])
    # What strikes at one time is apart by errors, which are no more than the tolerance.
    near = 1e-6 * t_end if case.name.startswith("simultaneous") else 1e-9 * t_end
    stop -= _LATE * t_end
    true = [
        (float(i.time), (i.constraint, i.side), float(i.impulse))
        for i in motion.impacts
        if float(i.time) < stop
    ]
    columns = zip(
        result.impact_time.tolist(),
        zip(result.impact_constraint.tolist(), result.impact_side.tolist(), strict=True),
        result.impact_impulse.tolist(),
        strict=True,
    )
    stated = [entry for entry in columns if entry[0] < stop]
    size = max((impulse for _, _, impulse in true), default=0.0)
    near = _clear_interval(near, *([time for time, *_ in each] for each in (true, stated)))
    expected, found = (_clusters(entries, near) for entries in (true, stated))
    unknown = _unknown_impulse(result, motion, horizon, case.document)
    largest = [max(c[1].values()) for c in (*expected, *found)]
    floor = _clear_floor(largest, unknown, size)
    expected, found = (
        [c for c in clusters if max(c[1].values()) > floor] for clusters in (expected, found)
    )
    if len(expected) != len(found):
        message = f"{len(found)} stated, {len(expected)} true before {stop!r} of {t_end!r}"
        report.fail("impacts", f"{message}; predictable until {horizon!r}")
        return
    for (time, impulses), (stated_time, stated_impulses) in zip(expected, found, strict=True):
        if abs(time - stated_time) > _LATE * t_end:
            report.fail("impacts", f"at {stated_time!r}, in truth at {time!r}")
            return
        for key in {*impulses, *stated_impulses}:
            off = abs(impulses.get(key, 0.0) - stated_impulses.get(key, 0.0))
            if off > max(1e-4 * size, unknown):
                message = f"of {key} at {time!r}: {stated_impulses.get(key)!r}"
                report.fail("impacts", f"impulse {message}, in truth {impulses.get(key)!r}")
                return
    _columns(result, motion, stop, report)


def _contacts(result: time_history.Result, motion: History, t_end: float, report: Report) -> None:
    """Compare contacts that take the same time, nearly, with their stated errors.

    Those that end and begin again at once may be one or several.
    """
    if result.contact_rest is None:
        return
    assert result.contact_stop is not None
    assert result.contact_constraint is not None
    assert result.contact_side is not None
    keys = zip(result.contact_constraint.tolist(), result.contact_side.tolist(), strict=True)
    times = zip(result.contact_rest.tolist(), result.contact_stop.tolist(), strict=True)
    stated = [(*key, *when) for key, when in zip(keys, times, strict=True)]
    true = [(c.constraint, c.side, float(c.rest), float(c.stop)) for c in motion.contacts]
    if not stated or not true:
        return
    until = min(t_end, result.error_predictable_until, max(stop for *_, stop in true))
    pairs = [
        (row, place)
        for row, one in enumerate(stated)
        for place, other in enumerate(true)
        if _alike(one, other, until) and all(map(_apart, ((stated, row), (true, place))))
    ]
    for name in ("rest", "stop", "impulse"):
        some = [(r, p) for r, p in pairs if name == "rest" or stated[r][3] < t_end]
        if some:
            rows = np.array([r for r, _ in some])
            errors = np.asarray(stated_error(result, f"contact_{name}"))[rows]
            values = getattr(result, f"contact_{name}")[rows]
            exact = [getattr(motion.contacts[p], name) for _, p in some]
            report.compare(f"contact {name}", values, exact, errors)


_At = tuple[int, int, float, float]


def _alike(one: _At, other: _At, until: float) -> bool:
    """Tell whether two contacts before some time are the same one."""
    (*key, rest, stop), (*other_key, other_rest, other_stop) = one, other
    shared = min(stop, other_stop) - max(rest, other_rest)
    longest = max(stop - rest, other_stop - other_rest)
    return key == other_key and stop <= until and shared > 0.5 * longest


def _apart(of: tuple[list[_At], int]) -> bool:
    """Tell whether no other contact at the same wall ends or begins beside one of some."""
    contacts, place = of
    *key, rest, stop = contacts[place]
    others = [c for i, c in enumerate(contacts) if i != place and [*c[:2]] == key]
    near = _LATE * max(stop, 1e-300)
    return all(c[3] < rest - near or c[2] > stop + near for c in others)


def _chatter_start(motion: History, contact: Contact) -> float:
    """Return a time before which no chatter that ends in this contact can have been summed."""
    bounces = [
        float(i.time)
        for i in motion.impacts
        if (i.constraint, i.side) == (contact.constraint, contact.side) and i.time < contact.rest
    ]
    return bounces[-60] if len(bounces) >= 60 else (bounces[0] if bounces else float(contact.rest))


def _clusters(
    entries: list[tuple[float, tuple[int, int], float]], near: float
) -> list[tuple[float, dict[tuple[int, int], float]]]:
    """Return the sums of impulses of impacts that follow one another at once."""
    clusters: list[tuple[float, dict[tuple[int, int], float]]] = []
    last = -np.inf
    for time, key, impulse in sorted(entries):
        if time - last > near:
            clusters.append((time, {}))
        sums = clusters[-1][1]
        sums[key] = sums.get(key, 0.0) + impulse
        last = time
    return clusters


def _columns(result: time_history.Result, motion: History, stop: float, report: Report) -> None:
    """Compare times, velocities and impulses with their stated errors, where these exist."""
    true = [(float(i.time), i.constraint, i.side, i) for i in motion.impacts]
    assert result.impact_time is not None
    assert result.impact_constraint is not None
    true = [entry for entry in true if entry[0] < stop]
    order = np.argsort(result.impact_time, kind="stable")
    order = order[result.impact_time[order] < stop]
    keys = [(int(result.impact_constraint[k])) for k in order]
    if keys != [entry[1] for entry in true]:
        report.count("impacts in another order")
        return
    for name in ("time", "velocity", "impulse"):
        error = stated_error(result, f"impact_{name}")
        if len(order):
            values = getattr(result, f"impact_{name}")[order]
            exact = [getattr(entry[3], name) for entry in true]
            report.compare(f"impact {name}", values, exact, np.asarray(error)[order])
