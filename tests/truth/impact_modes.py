"""Random solutions of families, and what their results state against what is true."""

from __future__ import annotations

from typing import Any

import numpy as np
from flint import arb

from tests.reference.balls import UndecidedError
from tests.reference.impact_modes import Family, Solution, solved
from tests.truth import structures
from tests.truth.verdicts import Case, Report, stated_error
from vibroimpact_solvers import impact_modes

OUTPUTS = ("impulse", "shape", "waveform", "energy", "harmonics", "stability")
ORDERS = 5
TAU = (-0.71875, 0.3125, 0.90625)  # of few bits: quick for the reference


def case(rng: np.random.Generator) -> Case:
    """Return a random solution."""
    kind = str(rng.choice(structures.KINDS))
    document = structures.structure(rng, kind)
    n = len(document["M"])
    document["constraints"] = structures.constraints(rng, n)
    if kind == "mirror" and rng.random() < 0.6:
        middle = n // 2 if rng.random() < 0.5 else None
        document["constraints"][0] = structures.constraint(rng, n, middle, "equal")
        struck = sorted(document["constraints"][0]["dofs"])
        others = [c for c in document["constraints"][1:] if sorted(c["dofs"]) != struck]
        document["constraints"][1:] = others
    if kind != "free" and rng.random() < 0.2:
        document["force"] = (rng.normal(size=n) * 0.3).tolist()
    count = len(document["constraints"])
    some = rng.permutation(count)[: int(rng.integers(1, count + 1))]
    rows = np.array([structures.row(document, document["constraints"][a]) for a in some])
    if np.linalg.matrix_rank(rows) < len(rows):  # impulses would not be unique
        some = some[:1]
    active = sorted(int(a) for a in some)
    Omega, near = _frequency(rng, document)
    document.update(active=active, Omega=Omega)
    name = f"{kind}, {near}"
    if count > len(active) and rng.random() < 0.3 and _graze(rng, document):
        name += ", grazing"
    return Case(name, document)


def _frequency(rng: np.random.Generator, document: structures.Document) -> tuple[float, str]:
    M, K = np.array(document["M"]), np.array(document["K"])
    values = np.linalg.eigvals(np.linalg.solve(M, K)).real
    natural = np.sqrt(values[values > 1e-10 * np.abs(values).max()])
    if not natural.size:
        return float(10.0 ** rng.uniform(-1, 1)), "anywhere"
    top = natural.max()
    low = max(natural.min(), top * 1e-4)
    choice = rng.random()
    off = 1.0 + float(rng.choice([-1, 1])) * 10.0 ** rng.uniform(-14, -1)
    if choice < 0.4:
        return float(np.exp(rng.uniform(np.log(0.3 * low), np.log(3.0 * top)))), "anywhere"
    if choice < 0.5:
        return float(top * (1.0 + 10.0 ** rng.uniform(-12, 0))), "above spectrum"
    natural = natural[natural >= low]
    if choice < 0.75:
        return float(rng.choice(natural) * off), "at natural frequency"
    return float(rng.choice(natural) / rng.integers(1, 5) * off), "at internal resonance"


def _graze(rng: np.random.Generator, document: structures.Document) -> bool:
    """Put the wall of an idle limiter near the turning point of its coordinate."""
    idle = [a for a in range(len(document["constraints"])) if a not in document["active"]]
    a = int(rng.choice(idle))
    problem = problem_of(document, frozenset({"waveform"}), np.linspace(-1, 1, 401))
    x = impact_modes.solve(problem, impact_modes.plan(problem)).waveform
    assert x is not None
    limiter = document["constraints"][a]
    y = x[0] @ structures.row(document, limiter)
    highest = float(np.abs(y).max()) * (
        1.0 + float(rng.choice([-1, 1])) * 10.0 ** rng.uniform(-14, -3)
    )
    if not 1e-6 < highest < 1e6:
        return False
    limiter.update(lower=highest, upper=highest)
    return True


def problem_of(
    document: structures.Document, outputs: frozenset[str], tau: Any = TAU
) -> impact_modes.Problem:
    """Return the solvers' problem."""
    Omega = np.array([document["Omega"]])
    return impact_modes.Problem(
        structures.system(document),
        Omega * (2.0 / np.pi),
        tuple(document["active"]),
        outputs,
        tau=np.array(tau),
        Omega=Omega,
        highest_harmonic=ORDERS,
    )


def family(document: structures.Document) -> Family:
    """Return the reference's family."""
    structure = structures.reference(document, conservative=True)
    return Family(structure, structures.limiters(document), tuple(document["active"]))


def check(case: Case, report: Report) -> None:
    """Compare the solution of a case with its reference."""
    document = case.document
    commuting = len(document["active"]) == 1
    outputs = frozenset(OUTPUTS) | {"exists", "reason"}
    problem = problem_of(document, outputs)
    plan = impact_modes.plan(problem)
    report.work(plan)
    result = impact_modes.solve(problem, plan)
    report.phase("reference")
    try:
        solution = solved(family(document), document["Omega"])
    except UndecidedError:
        solution = None
    if solution is None:
        report.count("undecided solutions")
        return
    _check_existence(solution, result, report)
    if result.reason is not None and result.reason[0] == impact_modes.Reason.SINGULAR:
        report.count("singular solutions")
        return
    _check_numbers(solution, result, report)
    if commuting and result.stability is not None and np.isfinite(result.stability[0]):
        try:
            precise = solved(family(document), document["Omega"], Solution.narrow_radius)
        except UndecidedError:
            report.count("undecided stability")
            return
        true = precise.radius()
        error = stated_error(result, "stability")
        report.compare("stability", [result.stability[0]], [arb(true)], np.ravel(error)[0])


def _check_existence(solution: Solution, result: impact_modes.Result, report: Report) -> None:
    assert result.exists is not None
    assert result.certified is not None
    assert result.reason is not None
    exists, certified = bool(result.exists[0]), bool(result.certified[0])
    try:
        true = solution.exists()
    except UndecidedError:
        true = None
    reason = result.reason[0]
    label = "certified" if certified else "not certified"
    report.count(f"existence {label}")
    if result.extended is not None and result.extended[0]:
        report.count("existence decided in ball arithmetic")
    if true is None:
        report.count("existence undecided by the reference")
        smallest = min(float(abs(p).upper()) for p in solution.impulse.values() or [arb(1)])
        if exists and certified and smallest < 1e-25:
            report.fail("existence", "exists and certified with an impulse of zero")
        return
    if exists != true:
        loose = solution.exists(allowance=1e-10)
        kind = "existence" if certified else "existence, not certified"
        if certified and exists and loose is not False:
            kind = "existence, within 1e-10"
        message = f"exists {exists} ({impact_modes.REASONS[reason]}) but in truth {true}"
        report.fail(kind, message)
    elif exists is False and certified and reason == impact_modes.Reason.NEGATIVE_IMPULSE:
        n = len(solution.impulse) + len(solution.impulse_lower)
        if not any(solution.pushes[2 * k] < 0 for k in range(n)):
            report.fail("reason", "no impulse is negative")


def _check_numbers(solution: Solution, result: impact_modes.Result, report: Report) -> None:
    p_true = [solution.impulse.get(a, arb(0)) for a in solution.active]
    low_true = [solution.impulse_lower.get(a, arb(0)) for a in solution.active]
    assert result.impulse is not None
    stated = [*result.impulse[0]]
    true = list(p_true)
    if result.impulse_lower is not None:
        stated += [*result.impulse_lower[0]]
        true += low_true
    errors = [*np.ravel(stated_error(result, "impulse"))]
    if result.impulse_lower is not None:
        errors += [*np.ravel(stated_error(result, "impulse_lower"))]
    report.compare("impulse", stated, true, errors)
    outputs: dict[str, tuple[Any, list[Any]]] = {
        "shape": (result.shape, solution.displacement(1.0)),
        "waveform": (result.waveform, [x for t in TAU for x in solution.displacement(t)]),
        "energy": (result.energy, [solution.energy]),
    }
    if result.harmonics is not None:
        assert result.harmonic is not None
        try:
            harmonics = [x for order in result.harmonic for x in solution.harmonic(int(order))]
            outputs["harmonics"] = (result.harmonics, harmonics)
        except UndecidedError:
            report.count("undecided harmonics")
    for name, (values, true_values) in outputs.items():
        if values is None:
            continue
        error = np.asarray(stated_error(result, name))
        shape = np.broadcast_to(error[0], np.asarray(values)[0].shape)
        report.compare(name, np.ravel(values), true_values, np.ravel(shape))
