"""Random driven structures and their periodic motions with at most one impact in a cell."""

from __future__ import annotations

from typing import Any

import numpy as np
from flint import acb_mat, arb, arb_mat
from scipy.optimize import linear_sum_assignment

from tests.reference.periodic import Impact, Motion, Structure
from tests.truth import structures
from tests.truth.structures import Document
from tests.truth.verdicts import ROUNDING, Case, Report
from vibroimpact_solvers import periodic_motions
from vibroimpact_solvers.errors import PlanError
from vibroimpact_solvers.results.impact_modes import Reason
from vibroimpact_solvers.results.periodic_motions import Result

TWO_PI = 2.0 * np.pi
_POINTS = 1201  # of the paths on which limits and extremes are checked
_PHASES = 40_001  # at which solutions are looked for
_DIGITS = 1e-45  # to which the reference knows multipliers, by the largest one
_KEEPING = 1e-13  # of the mobility, what is left of it where impacts and damping take nothing
_ILL = 1e7  # condition number of complex modes from which doubles need not tell them apart
_DAMPED = 1e-3  # damping ratio from which work and losses agree to twelve digits
_APART = 1e-5  # relative distance of rates from which modes do not absorb one another
_SMALL = 8  # degrees of freedom up to which energies are compared
_PATIENCE = 900.0  # seconds for the reference of larger ones


def case(rng: np.random.Generator) -> Case:
    """Return a random driven structure."""
    if rng.random() < 0.02:
        return random_case(rng, "large", int(rng.integers(10, 51)))
    n = int(rng.integers(2, 7))
    return random_case(rng, str(rng.choice(["dense", "diagonal", "chain", "mirror"])), n)


def large_case(rng: np.random.Generator) -> Case:
    """Return one with more degrees of freedom, up to 50."""
    n = int(rng.integers(10, 51))
    return random_case(rng, "large", n, least=n - 5)


def random_case(rng: np.random.Generator, name: str, n: int, least: int = 1) -> Case:
    """Return a random structure of a kind, with at most about n degrees of freedom."""
    large = name == "large"
    document = structures.structure(rng, "dense" if large else name, n)
    while len(document["M"]) < least:
        document = structures.structure(rng, "dense", n)
    M, K = np.array(document["M"]), np.array(document["K"])
    n = M.shape[0]
    lowest = float(np.sqrt(np.linalg.eigvals(np.linalg.solve(M, K)).real.min()))
    ratio = float(10.0 ** rng.uniform(-3.0, -0.7))
    if rng.random() < 0.5:
        C = ratio * (K / lowest + M * lowest)
    else:
        spread = rng.standard_normal((n, n))
        C = 2.0 * ratio * lowest * (spread @ spread.T / n + 0.05 * np.eye(n)) * np.diag(M).mean()
        name += ", coupled"
    document["C"] = (0.5 * (C + C.T)).tolist()
    document["symmetric"] = symmetric = bool(rng.random() < 0.25)
    styles = ["equal"] if symmetric else ["equal", "unequal", "upper", "lower"]
    limiters = [structures.constraint(rng, n, style=str(rng.choice(styles)))]
    if n > 1 and rng.random() < 0.3:
        idle = structures.constraint(rng, n, style="equal" if symmetric else None)
        if sorted(idle["dofs"]) != sorted(limiters[0]["dofs"]):
            limiters.append(idle)
    size = 10.0 ** rng.uniform(-1.5, 0.5)
    for limiter in limiters:
        limiter["restitution"] = float(rng.choice([rng.uniform(0.1, 1.0), 1.0], p=[0.9, 0.1]))
        for side in ("lower", "upper"):
            limiter[side] = None if limiter[side] is None else size * limiter[side]
    document["constraints"] = limiters
    still = symmetric or rng.random() < 0.6
    stiffness = float(np.abs(K).max())
    document["force"] = (
        np.zeros(n) if still else 0.3 * stiffness * size * rng.standard_normal(n)
    ).tolist()
    harmonics = [1, 3, 5] if symmetric else [1, 2, 3, 7]
    chosen = sorted({1, *rng.choice(harmonics, int(rng.integers(1, 4))).tolist()})
    document["loads"] = [
        [
            int(rng.integers(n)),
            float(stiffness * 10.0 ** rng.uniform(-1.0, 1.0) / h),
            h,
            float(rng.uniform(0.0, 6.0)),
        ]
        for h in chosen
    ]
    document["periods"] = 1 if symmetric else int(rng.choice([1, 2, 3], p=[0.7, 0.2, 0.1]))
    sides = [side for side, name in ((-1, "lower"), (1, "upper")) if limiters[0][name] is not None]
    document["side"] = 1 if symmetric else int(rng.choice(sides))
    top = float(np.sqrt(np.linalg.eigvals(np.linalg.solve(M, K)).real.max()))
    document["Omega"] = np.sort(
        rng.uniform(np.log(0.3 * lowest), np.log(3.0 * top), 1 if large else 2)
    ).tolist()
    document["Omega"] = np.exp(document["Omega"]).tolist()
    return Case(name + (", symmetric" if symmetric else ""), document)


def spectral_case(rng: np.random.Generator) -> Case:
    """Return one with natural frequencies that are equal, or nearly, and damping of any rank.

    Impacts that take all of the velocity, or none, and drives beside a resonance are among them.
    """
    n = int(rng.integers(2, 7))
    spectrum = str(rng.choice(["repeated", "near", "turned", "symmetric"]))
    values = rng.uniform(0.5, 8.0, n)
    values[: int(rng.integers(2, n + 1))] = round(float(values[0]), 3)
    if spectrum == "near":
        values[: n // 2 + 1] *= 1.0 + 10.0 ** rng.uniform(-14.0, -6.0) * np.arange(n // 2 + 1)
    K = np.diag(values)
    if spectrum == "turned":
        Q, _ = np.linalg.qr(rng.standard_normal((n, n)))
        K = (Q * values) @ Q.T
    elif spectrum == "symmetric":  # each is joined to each
        K = float(rng.integers(1, 9)) / 4.0 * (n * np.eye(n) - 1.0) + np.eye(n)
    M, lowest = np.eye(n), float(np.sqrt(np.linalg.eigvalsh(K)[0]))
    ratio = float(10.0 ** rng.uniform(-3.0, -0.7))
    damping = str(rng.choice(["proportional", "of some", "rank-deficient", "coupled"]))
    if damping == "proportional":
        C = ratio * (K / lowest + M * lowest)
    elif damping == "of some":
        C = np.diag(2.0 * ratio * lowest * (rng.random(n) < 0.7))
    else:
        spread = np.round(rng.standard_normal((n, int(rng.integers(1, n)))), 2)
        C = 2.0 * ratio * lowest * (spread @ spread.T / n)
        C += 0.1 * ratio * lowest * np.eye(n) if damping == "coupled" else 0.0
    K, C = (0.5 * (A + A.T) for A in (K, C))
    style = str(rng.choice(["equal", "upper"]))
    limiter = structures.constraint(rng, n, style=style)
    if rng.random() < 0.5:
        limiter["dofs"] = list(range(n))
        limiter["weights"] = np.round(rng.standard_normal(n), 2).tolist()
    limiter["restitution"] = float(
        rng.choice([0.0, 1e-12, 1e-3, rng.uniform(0.1, 1.0), 1.0], p=[0.15, 0.1, 0.1, 0.5, 0.15])
    )
    symmetric = style == "equal" and bool(rng.random() < 0.3)
    Omega = np.exp(rng.uniform(np.log(0.3 * lowest), np.log(6.0), 2))
    if rng.random() < 0.3:
        resonance = float(np.sqrt(values[0])) * float(rng.choice([0.5, 1.0, 2.0]))
        Omega[0] = resonance * (1.0 + 10.0 ** rng.uniform(-8.0, -2.0))
    document = {
        "M": M.tolist(), "K": K.tolist(), "C": C.tolist(), "symmetric": symmetric,
        "constraints": [limiter], "force": np.zeros(n).tolist(),
        "loads": [[int(rng.integers(n)), float(10.0 ** rng.uniform(-0.5, 1.0)), 1, 0.0]],
        "periods": 1, "side": 1, "Omega": np.sort(Omega).tolist(),
    }  # fmt: skip
    return Case(f"{spectrum}, {damping}" + (", symmetric" if symmetric else ""), document)


def problem(document: Document) -> periodic_motions.Problem:
    """Return the problem of the solvers."""
    load = tuple(
        periodic_motions.Force((dof,), (1.0,), amplitude, harmonic, phase)
        for dof, amplitude, harmonic, phase in document["loads"]
    )
    sequence: Any = (periodic_motions.Impact(0, document["side"]),)
    return periodic_motions.Problem(
        structures.system(document),
        np.array(document["Omega"]),
        load,
        periods=document["periods"],
        sequence=periodic_motions.SYMMETRIC if document["symmetric"] else sequence,
    )


def motion(document: Document, Omega: float) -> Motion:
    """Return the reference of the motions at a frequency."""
    first = document["constraints"][0]
    wall = first["upper"] if document["side"] > 0 else first["lower"]
    impact = Impact(
        structures.row(document, first), document["side"] * wall, document["side"],
        first["restitution"],
    )  # fmt: skip
    matrices = (np.array(document[name]) for name in ("M", "C", "K", "force"))
    loads = [tuple(term) for term in document["loads"]]
    structure = Structure(*matrices, loads, Omega)
    half = 0.5 if document["symmetric"] else 1.0
    sign = -1 if document["symmetric"] else 1
    return Motion(structure, impact, document["periods"] * half, sign)


def check(case: Case, report: Report) -> None:
    """Compare the motions of a case with their reference."""
    document = case.document
    given = problem(document)
    plan = periodic_motions.plan(given)
    report.work(plan)
    try:
        result = periodic_motions.solve(given, plan)
    except PlanError as error:
        report.phase("reference")
        condition = motion(document, document["Omega"][0]).s.condition()
        if "almost equal" not in str(error) or condition < _ILL:
            raise
        report.count("refused: complex modes that are almost one")
        return
    report.phase("reference", _PATIENCE if len(document["M"]) > _SMALL else None)
    for index, Omega in enumerate(document["Omega"]):
        exact = motion(document, Omega)
        rows = np.flatnonzero(result.solution_frequency_index == index)
        struck = rows[result.solution_impacts[rows] > 0]
        _count_solutions(exact, struck.size, bool(result.complete[index]), report)
        for row in rows:
            if result.solution_impacts[row]:
                _check_impact(document, exact, result, int(row), report)
            else:
                state = exact.without_impact()
                _check_energies(document, exact, arb(0), state, arb(0), result, int(row), report)
                path = exact.path(arb(0), state, _POINTS)
                _check_path(document, path, result, int(row), None, report)


def _count_solutions(exact: Motion, count: int, complete: bool, report: Report) -> None:
    """Compare the number of solutions with the zeros of the distance from the wall."""
    if exact.gain() < _KEEPING:
        report.count("solutions: impacts that take nothing, of what nothing damps")
        return
    distance = exact.distances(np.linspace(0.0, TWO_PI, _PHASES))
    crossings = int((np.diff(np.signbit(distance)) != 0).sum())
    turns = np.flatnonzero(np.diff(np.sign(np.diff(distance)))) + 1
    touch = np.abs(distance[turns]).min(initial=np.inf) < 1e-6 * np.abs(distance).max()
    report.count("frequencies")
    report.count("complete" if complete else "solutions: said to be incomplete")
    if touch:
        report.count("solutions: two about to meet")
    elif not complete and count < crossings:
        report.count("solutions: missing where said to be incomplete", crossings - count)
    elif count != crossings:
        report.fail("number of solutions", f"{count} instead of {crossings}")
    report.count("solutions", crossings)


def _check_impact(
    document: Document, exact: Motion, result: Result, row: int, report: Report
) -> None:
    at = int(np.flatnonzero(result.impact_solution == row)[0])
    stated = float(result.impact_phase[at])
    phase, p, velocity, state = exact.refined(stated)
    turns = round(float((phase - arb(stated)).mid()) / TWO_PI)
    report.compare("phase", [stated], [phase - 2 * turns * arb.pi()], result.error_phase[at])
    side = document["side"]
    for what, value, true, error in (
        ("momentum", result.impact_momentum[at], -side * p, result.error_momentum[at]),
        ("velocity", result.impact_velocity[at], velocity, result.error_velocity[at]),
    ):
        report.compare(what, [float(value)], [true], error)
    k = arb(document["constraints"][0]["restitution"])
    impact = (1 - k * k) / (2 * exact.mu) * velocity * velocity
    _check_energies(document, exact, phase, state, impact, result, row, report)
    path = exact.path(phase, state, _POINTS)
    _check_path(document, path, result, row, float((-side * p).mid()), report)
    _check_multipliers(exact, phase, state, p, result, row, report)


def _check_energies(
    document: Document,
    exact: Motion,
    phase: arb,
    state: arb_mat,
    impact: arb,
    result: Result,
    row: int,
    report: Report,
) -> None:
    """Compare work and losses with each other, and with those of the reference."""
    work, lost = result.solution_work, result.solution_energy_lost
    assert work is not None
    assert lost is not None
    # The work is that of the response without impacts and of what impacts change in it.
    alone = (result.solution_frequency_index == result.solution_frequency_index[row]) & (
        result.solution_impacts == 0
    )
    size = max(float(lost[row]), float(lost[alone].max(initial=0.0)))
    # Less damping takes a smaller part of what flows to and fro than the phase, as a double, lets
    # be known to twelve digits: the errors of both are then what is checked.
    # So are they where modes of nearly the same frequency absorb one another.
    damped = exact.s.damping_ratio() >= _DAMPED and exact.s.separation() >= _APART
    # A phase as a double moves the work by a part of what flows to and fro, however little that
    # loses on the whole.
    to_and_fro = 4.0 * ROUNDING * _flow(document, result, row)
    if damped and abs(float(work[row] - lost[row])) > 1e-12 * size + to_and_fro:
        report.fail("work is what is lost", f"{work[row]!r} of the load, {lost[row]!r} lost")
    if exact.s.n > _SMALL:
        return
    true_work, true_lost = exact.energies(phase, state)
    both = 2 if exact.sign < 0 else 1
    for what, value, true, error in (
        ("work", work, true_work, result.error_work),
        ("energy_lost", lost, true_lost + impact, result.error_energy_lost),
    ):
        assert error is not None
        report.compare(what, [float(value[row])], [both * true], float(error[row]))


def _flow(document: Document, result: Result, row: int) -> float:
    """Return a bound of the change of a period's work by the phase, from the amplitudes."""
    assert result.solution_x_max is not None
    assert result.solution_x_min is not None
    wide = 0.5 * (result.solution_x_max[row] - result.solution_x_min[row])
    each = (abs(amplitude) * wide[dof] * h for dof, amplitude, h, _ in document["loads"])
    return float(np.pi * document["periods"] * sum(each))


def _check_path(
    document: Document,
    path: np.ndarray,
    result: Result,
    row: int,
    momentum: float | None,
    report: Report,
) -> None:
    """Compare extremes and verdict with a path of many points, both ends included."""
    # Between neighbouring points a coordinate leaves their chord by less than this.
    bend = 0.25 * np.abs(np.diff(path, 2, axis=0)).max(axis=0)
    whole = np.concatenate([path, -path]) if document["symmetric"] else path
    high, low = whole.max(axis=0), whole.min(axis=0)
    for what, found, error, least, most in (
        ("x_max", result.solution_x_max, result.error_x_max, high, high + bend),
        ("x_min", result.solution_x_min, result.error_x_min, low - bend, low),
    ):
        assert found is not None
        assert error is not None
        if not ((found[row] + error[row] >= least) & (found[row] - error[row] <= most)).all():
            report.fail(what, f"{found[row]} is not between {least} and {most}")
    assert result.solution_exists is not None
    assert result.solution_certified is not None
    allowed = _allowed(document, path, momentum)
    exists, certified = bool(result.solution_exists[row]), bool(result.solution_certified[row])
    report.count("verdicts certified" if certified else "verdicts not certified")
    if allowed is None:
        report.count("verdict: undecided by points")
    elif exists != allowed:
        assert result.solution_reason is not None
        reason = Reason(int(result.solution_reason[row])).name.lower()
        kind = "verdict certified" if certified else "verdict not certified"
        report.fail(kind, f"{reason}, in truth {'admissible' if allowed else 'not'}")


def _allowed(document: Document, path: np.ndarray, momentum: float | None) -> bool | None:
    """Return whether a motion is admissible; None where points are too few to tell."""
    if momentum is not None and momentum <= 0.0:
        return False  # walls only push
    sure = True
    for index, limiter in enumerate(document["constraints"]):
        y = path @ structures.row(document, limiter)
        bend = 0.25 * float(np.abs(np.diff(y, 2)).max())
        for side, wall in ((1, limiter["upper"]), (-1, limiter["lower"])):
            if wall is None:
                continue
            for mirror in (1, -1) if document["symmetric"] else (1,):
                over = mirror * side * y - wall
                here = momentum is not None and index == 0
                ends = here and (side == document["side"] if not document["symmetric"] else True)
                inner = over[1:-1] if ends else over
                if float(inner.max()) > 1e-9 * wall:
                    return False
                if ends and max(over[0], over[-1]) > -1e-9 * wall:
                    # The ends are at the wall: the motion leaves it at once.
                    sure &= bool(over[1] < -4.0 * bend or abs(over[0]) > 1e-9 * wall)
                    sure &= bool(over[-2] < -4.0 * bend or abs(over[-1]) > 1e-9 * wall)
                    sure &= float(over[1:-1].max()) + bend < 0.0 or _falls(over, bend)
                else:
                    sure &= float(over.max()) + bend < -1e-9 * wall
    return True if sure else None


def _falls(over: np.ndarray, bend: float) -> bool:
    """Return whether a path that starts and ends at a wall stays away from it in between."""
    near = np.flatnonzero(over + bend >= 0.0)
    inner = near[(near > 1) & (near < over.size - 2)]
    return inner.size == 0


def _check_multipliers(
    exact: Motion, phase: arb, state: arb_mat, p: arb, result: Result, row: int, report: Report
) -> None:
    assert result.multipliers_real is not None
    assert result.multipliers_imaginary is not None
    assert result.error_multipliers_real is not None
    values = result.multipliers_real[row] + 1j * result.multipliers_imaginary[row]
    errors = result.error_multipliers_real[row]
    if not np.isfinite(values).all():
        report.count("multipliers: grazing")
        return
    matrix = exact.monodromy(phase, state, p)
    middle = acb_mat([[matrix[i, j].mid() for j in range(values.size)] for i in range(values.size)])
    true = middle.eig(algorithm="approx")
    power = 2 if exact.sign < 0 else 1
    expected = np.array([complex(value.mid()) ** power for value in true])
    apart = np.abs(values[:, np.newaxis] - expected)
    ours, theirs = linear_sum_assignment(apart)
    off = apart[ours, theirs]
    # Roundings of the comparison, and those of the reference's matrix in small eigenvalues.
    least = 4.0 * ROUNDING * np.abs(expected[theirs]) + _DIGITS * np.abs(expected).max()
    ratios = np.maximum(errors[ours] / np.maximum(off, least), off <= least)
    worst = int(ratios.argmin())
    report.ratios.setdefault("multipliers", []).append(float(ratios[worst]))
    if ratios[worst] < 1.0 and off[worst] > least[worst]:
        i, j = ours[worst], theirs[worst]
        message = f"{values[i]} instead of {expected[j]}, off by {off[worst]:.3g}"
        report.fail("multipliers", f"{message}, stated {errors[i]:.3g}")
    assert result.solution_stability is not None
    assert result.error_stability is not None
    largest = float(np.abs(expected).max())
    report.compare(
        "stability",
        [float(result.solution_stability[row])],
        [arb(largest)],
        float(result.error_stability[row]) + ROUNDING * largest,
    )
