"""Coupled impacts at one instant: states after them against the reference in balls."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from tests.reference.rigid import History
from tests.truth import histories
from tests.truth.histories import problem_of, truth
from tests.truth.sets import SETS
from tests.truth.structures import Document
from vibroimpact_solvers import ensemble
from vibroimpact_solvers import time_history as th
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.kernels.rigid_motion import follow
from vibroimpact_solvers.results.time_history import LAWS
from vibroimpact_solvers.time_history import run


def struck_at_once(seed: int) -> Document:
    """Return bodies in a row that touch, or that start at walls; unequal k, or all of them 1."""
    rng = np.random.default_rng(seed)
    m = int(rng.integers(2, 5))
    row = rng.random() < 0.5
    M = np.diag(np.round(np.exp(rng.uniform(-1.0, 1.0, m)), 3)) + (0.0 if row else 0.125)
    K = np.diag(rng.choice([0.0, 1.0, 3.0], m))
    k = rng.choice([0.3, 0.5, 0.7, 0.9, 1.0], m) if rng.random() < 0.7 else np.ones(m)
    constraints = [
        {
            "dofs": [i - 1, i] if row and i else [i],
            "weights": [-1.0, 1.0] if row and i else [1.0],
            "lower": None,
            "upper": 0.0,
            "restitution": float(k[i]),
        }
        for i in range(m)
    ]
    v = np.round(rng.normal(size=m), 3)
    document: Document = {"M": M.tolist(), "K": K.tolist(), "constraints": constraints}
    force = np.round(rng.normal(size=m), 3).tolist()  # which tells what stays at its wall
    start = {"x": [0.0] * m, "v": v.tolist(), "force": force}
    return document | start | {"t": [1e-6], "t_end": 1e-6}


@pytest.mark.parametrize("seed", range(30))
def test_impulses_are_those_of_the_reference(seed: int) -> None:
    document = struck_at_once(seed)
    problem = problem_of(document)
    result = th.solve(problem, th.plan(problem))
    motion = truth(document, math.inf)
    assert result.v is not None
    assert result.impact_impulse is not None
    assert result.impact_constraint is not None
    n = len(document["M"])
    expected = np.array([float(x) for x in motion.states[0].entries()[n : 2 * n]])
    largest = np.abs(document["v"]).max()
    np.testing.assert_allclose(result.v[0], expected, rtol=0.0, atol=1e-13 * largest)
    impulses = np.zeros((2, n))
    np.add.at(impulses[0], result.impact_constraint, result.impact_impulse)
    np.add.at(impulses[1], [i.constraint for i in motion.impacts], _impulses(motion))
    np.testing.assert_allclose(impulses[0], impulses[1], rtol=0.0, atol=1e-12 * largest)


def _impulses(motion: History) -> list[float]:
    return [float(impact.impulse) for impact in motion.impacts]


def stack(M: list[float], gaps: list[float], k: float, **rest: object) -> Document:
    """Return balls one above the other under their weights, above a floor."""
    n = len(M)
    constraints = [
        {
            "dofs": [i - 1, i] if i else [0],
            "weights": [-1.0, 1.0] if i else [1.0],
            "lower": gap,
            "upper": None,
            "restitution": k,
        }
        for i, gap in enumerate(gaps)
    ]
    document: Document = {"M": np.diag(M).tolist(), "K": np.zeros((n, n)).tolist()}
    return document | {"constraints": constraints, "x": [0.0] * n} | rest


def solve(document: Document) -> th.Result:
    problem = problem_of(document)
    return th.solve(problem, th.plan(problem))


def test_a_stack_comes_to_rest() -> None:
    """It bounced a million times, as impacts of several gained energy, and was refused."""
    g, M = 9.81, [2.0, 0.5, 2.0]
    result = solve(
        stack(
            M, [0.1, 0.25, 0.0], 0.7, K=np.diag([10.0, 0.0, 10.0]).tolist(),
            force=[-g * m for m in M], v=[-0.5, 0.0, 1.0], t=np.linspace(0.0, 3.0, 31).tolist(),
            t_end=3.0,
        )
    )  # fmt: skip
    assert result.x is not None
    assert result.energy is not None
    assert result.contact_stop is not None
    np.testing.assert_allclose(result.x[-1], [-0.1, -0.35, -0.35], rtol=1e-14)
    assert result.energy[-1] == pytest.approx(-9.88325, rel=1e-14)
    assert (np.diff(result.energy) <= 1e-12).all()
    assert (result.contact_stop == 3.0).sum() == 3
    assert result.count_impacts < 1000


@pytest.mark.parametrize(("k", "energy"), [(1.0, 1.25), (0.7, -6.0)])
def test_balls_that_touch_above_a_floor_are_followed_to_the_end(k: float, energy: float) -> None:
    """There was no answer for minutes; at rest the energy is that of the height."""
    result = solve(
        stack(
            [2.0, 2.0, 2.0], [1.0, 0.0, 0.0], k, force=[-2.0, -2.0, -2.0], v=[1.0, 0.0, -0.5],
            t=np.linspace(0.0, 5.0, 51).tolist(), t_end=5.0,
        )
    )  # fmt: skip
    assert result.energy is not None
    assert (np.diff(result.energy) <= 1e-12).all()
    assert result.energy[-1] == pytest.approx(energy, rel=1e-12)


@pytest.mark.parametrize(
    ("k", "laws"),
    [
        ((1.0, 1.0), ["moreau", "moreau"]),
        ((0.5, 0.5), ["poisson", "poisson"]),
        ((1.0, 0.5), ["poisson", "poisson"]),
    ],
)
def test_impacts_tell_their_law(k: tuple[float, float], laws: list[str]) -> None:
    """Two coupled masses strike at the start, then each returns by its own spring, alone."""
    document = stack([1.0, 1.0], [0.0, 0.0], 1.0, v=[-1.0, -0.5], t=[4.0], t_end=4.0)
    document["K"] = [[1.0, 0.0], [0.0, 2.0]]
    document["M"] = [[1.0, 0.25], [0.25, 1.0]]
    for i in range(2):
        document["constraints"][i] |= {"dofs": [i], "weights": [1.0], "restitution": k[i]}
    result = solve(document)
    assert result.impact_law is not None
    assert result.impact_time is not None
    named = [LAWS[law] for law in result.impact_law]
    assert named[:2] == laws
    assert (result.impact_time[:2] == 0.0).all()
    assert len(named) > 2
    assert set(named[2:]) == {"newton"}


def test_uncoupled_impacts_at_one_instant_are_of_newtons_law() -> None:
    document = stack([1.0, 1.0], [0.0, 0.0], 0.5, v=[-1.0, -0.5], t=[0.5], t_end=0.5)
    document["constraints"][1] |= {"dofs": [1], "weights": [1.0]}
    result = solve(document)
    assert result.impact_law is not None
    assert [LAWS[law] for law in result.impact_law] == ["newton", "newton"]
    np.testing.assert_array_equal(result.v, [[0.5, 0.25]])


def test_motions_of_an_ensemble_tell_the_laws_of_their_impacts() -> None:
    system = problem_of(stack([1.0, 1.0], [0.0, 0.0], 0.5, v=[0.0, 0.0], t=[0.5], t_end=0.5)).system
    many = ensemble.Problem(system, np.zeros((2, 2)), np.array([[-1.0, -0.5], [-1.0, -2.0]]), 0.25)
    result = ensemble.solve(many, ensemble.plan(many))
    assert result.impact_law is not None
    assert result.impact_count is not None
    # The second one of the first motion recedes from the first one, which is struck.
    assert result.impact_count.min() >= 1
    assert {LAWS[law] for law in result.impact_law} == {"poisson"}


@pytest.mark.parametrize("masses", [(1.0, 0.1), (2.0, 0.3), (1.0, 1.0), (3.0, 0.7)])
@pytest.mark.parametrize(("lower", "upper"), [(1.0, 1.0), (0.7, 0.7), (0.4, 0.9)])
def test_two_balls_that_touch_are_dropped(
    masses: tuple[float, float], lower: float, upper: float
) -> None:
    """One law whatever the last bits of the masses are, and the order is not known.

    The blow without restitution stops both: impulses (m1 + m2) v and m2 v. Each wall gives back k
    times its own, so that both leave with k v; with the upper k larger the upper one leaves with
    that, and the lower one with less, or not at all.
    """
    g, t = 9.81, math.sqrt(2.0 / 9.81)
    document = stack(
        list(masses), [1.0, 0.0], lower, force=[-g * m for m in masses], v=[0.0, 0.0],
        t=[0.9 * t, t + 0.01], t_end=t + 0.01,
    )  # fmt: skip
    document["constraints"][1]["restitution"] = upper
    result = solve(document)
    assert result.v is not None
    assert result.error_v is not None
    assert result.impact_law is not None
    m1, m2 = masses
    up = g * t * np.array([((m1 + m2) * lower - m2 * upper) / m1, upper])
    after = np.where(up > 0.0, up - 0.01 * g, 0.0)
    np.testing.assert_allclose(result.v[1], after, rtol=0.0, atol=1e-12)
    assert np.isfinite(result.error_v[0]).all()
    assert np.isinf(result.error_v[1]).all()
    assert result.error_predictable_until == pytest.approx(t, rel=1e-14)
    assert LAWS[result.impact_law[0]] == ("moreau" if lower == upper == 1.0 else "poisson")


def test_bodies_that_rounding_takes_apart_fall_together() -> None:
    """Their damping is that of their masses but for the last bit: the search did not get on."""
    g, masses = 9.81, [0.23, 3.5]
    document = stack(
        masses, [0.5, 0.0], 0.9, force=[-g * m for m in masses], v=[0.0, 0.0],
        C=np.diag([0.1 * m for m in masses]).tolist(), t=[0.2, 0.3, 2.0], t_end=2.0,
    )  # fmt: skip
    result = solve(document)
    assert result.x is not None
    assert result.energy is not None
    fallen = -g / 0.1 * np.array([t - -math.expm1(-0.1 * t) / 0.1 for t in (0.2, 0.3)])
    np.testing.assert_allclose(result.x[:2], np.stack([fallen, fallen], 1), rtol=1e-13)
    assert (np.diff(result.energy) <= 1e-12).all()
    assert result.x[2, 0] >= -0.5 - 1e-12


def test_bodies_unlike_by_a_million_do_not_strike_for_ever() -> None:
    """What is left of their velocities after the impact is rounding, and struck again at once."""
    M = [810.0835, 0.0013, 0.0385, 0.0821, 0.0184]
    v = [0.351, -0.219, 0.182, 0.241, 2.238]
    document = stack(M, [0.0] * 5, 0.5, v=v, t=[1e-9], t_end=1e-9)
    k = (0.08596984935393825, 0.5974281818539776, 0.5315292316307386, 0.780796573638886,
         0.11482065998622504)  # fmt: skip
    for constraint, restitution in zip(document["constraints"], k, strict=True):
        constraint |= {"lower": None, "upper": 0.0, "restitution": restitution}
    result = solve(document)
    assert result.v is not None
    before, after = (0.5 * np.array(M) @ np.square(each) for each in (v, result.v[0]))
    assert after <= before
    rows = np.eye(5) - np.eye(5, k=-1)
    assert (rows @ result.v[0]).max() <= 1e-12


def test_bodies_a_little_apart_hand_the_blow_on() -> None:
    """Newton's cradle: one after the other, as far as is known."""
    gap = 1e-9
    document = stack([1.0, 1.0, 1.0], [1e9, gap, gap], 1.0, v=[1.0, 0.0, 0.0], t=[1.0], t_end=1.0)
    document["constraints"] = [
        c | {"lower": None, "upper": gap, "weights": [1.0, -1.0]}
        for c in document["constraints"][1:]
    ]
    result = solve(document)
    assert result.impact_law is not None
    np.testing.assert_allclose(result.v, [[0.0, 0.0, 1.0]], rtol=0.0, atol=1e-14)
    assert result.error_predictable_until == 1.0
    assert [LAWS[law] for law in result.impact_law] == ["newton", "newton"]


def test_what_leaves_with_a_speed_that_is_rounding_does_not_strike_for_ever() -> None:
    """With k = 0 beside another impact at the same instant: its blow was repeated without end."""
    document = stack(
        [3.0, 0.3, 0.3, 0.5], [1.0, 0.0, 0.25, 0.0], 0.9, v=[1.0, 0.5, 0.5, -1.0],
        K=np.diag([0.0, 10.0, 0.0, 0.0]).tolist(), t=[1.0, 2.0, 3.0], t_end=3.0,
    )  # fmt: skip
    for i, k in enumerate((0.9, 0.0, 0.9, 0.5)):
        document["constraints"][i]["restitution"] = k
    result = solve(document)
    assert result.energy is not None
    assert result.count_impacts < 20
    assert (np.diff(result.energy) <= 1e-12).all()


def test_structures_that_blows_bring_to_rest_stay_there() -> None:
    """What moves after that is rounding, which three coordinates handed on without end."""
    document = SETS["blows"].case(0, 343).document
    result = solve(document)
    assert result.energy is not None
    assert result.v is not None
    M, v = np.array(document["M"]), np.array(document["v"])
    after = result.v[0]
    assert after @ M @ after <= v @ M @ v


def test_walls_that_leave_no_room_stop_a_structure() -> None:
    """With k = 1 it was refused, as it went to and fro at the speed of roundings."""
    W = [[1.0, 0.0], [-2.0, -1.0], [3.0, 3.0]]  # W x <= 0 has x = 0 alone
    document: Document = {"M": [[1.0417, 0.5], [0.5, 1.7745]], "K": [[0.0, 0.0], [0.0, 0.0]]}
    document["constraints"] = [
        {"dofs": [0, 1], "weights": w, "lower": None, "upper": 0.0, "restitution": 1.0} for w in W
    ]
    result = solve(document | {"x": [0.0, 0.0], "v": [-1.775, -0.887], "t": [1.0], "t_end": 1.0})
    np.testing.assert_allclose(result.v, 0.0, rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(result.x, 0.0, rtol=0.0, atol=1e-14)


def test_what_is_slower_than_rounding_is_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    """The search found it at its wall, by other sums than the impact, millions of times."""
    m = [1.2, 0.5, 1.5]
    document = stack(m, [0.0, 0.0, 1e-9], 1.0, K=np.diag([0.0, 1.0, 0.0]).tolist())
    document["constraints"][1]["restitution"] = 0.3
    spent = list[int]()

    def counted(*given: object) -> tuple[int, int]:
        motion = given[1]
        assert isinstance(motion, tuple)
        before = int(motion[2]["expansions"][0])
        found = follow(*given)  # type: ignore[arg-type]
        spent.append(int(motion[2]["expansions"][0]) - before)
        return found

    monkeypatch.setattr(run, "follow", counted)
    document |= {"force": [-x for x in m], "v": [0.5, 0.0, -0.5], "t": [0.32], "t_end": 0.32}
    try:
        impacts = solve(document).count_impacts
    except ConvergenceError as error:
        # Where roundings of another processor wedge a body, it strikes on and on.
        found = re.match(r"(\d+) impacts and contacts .* many more than planned", str(error))
        assert found
        impacts = int(found[1])
    assert impacts > 20
    assert 0 < sum(spent) < 10 * impacts


def test_bodies_that_touch_without_a_force_are_struck_together() -> None:
    """A zero of a mode that was 2e-16 was taken for a force; they flew on as one body."""
    m = 0.5
    document = stack([m] * 4, [1.0, 0.25, 0.0, 0.25], 0.9, K=np.diag([0.0, 1.0, 1.0, 0.0]).tolist())
    document["constraints"][0]["restitution"] = 0.7
    document["constraints"][3]["restitution"] = 0.3
    document |= {"force": [-9.81 * m] * 4, "v": [-1.0, 0.5, 0.5, -1.0], "t": [0.3], "t_end": 0.3}
    result = solve(document)
    assert result.x is not None
    assert result.v is not None
    state = [float(x) for x in truth(document).states[0].entries()[:8]]
    np.testing.assert_allclose([*result.x[0], *result.v[0]], state, rtol=0.0, atol=1e-12)


def test_a_contact_from_the_start_that_rounding_delays() -> None:
    """Damping has no force but rounding at the start; the spring presses from then on.

    The rest was said to begin at 0 exactly: at 7.9e-17 by the numbers as they are.
    """
    C = np.diag([0.1 * 0.55, 0.1 * 0.79]).tolist()
    document = stack([0.55, 0.79], [1.0, 0.0], 0.0, K=[[10.0, 0.0], [0.0, 0.0]], C=C)
    document |= {"force": [-9.81 * 0.55, -9.81 * 0.79], "v": [0.5, -1.0], "t": [0.1], "t_end": 0.1}
    result = solve(document)
    assert result.contact_rest is not None
    assert result.error_contact_rest is not None
    late = float(truth(document).contacts[0].rest) - float(result.contact_rest[0])
    assert 0.0 < late <= float(result.error_contact_rest[0]) < 1e-12


def test_impacts_of_rounding_that_follow_one_another_faster_than_time_is_known() -> None:
    """Three walls at the origin of a free body; each impact is 5e-29 after the one before.

    They leave one direction free, along which its momentum stays.
    """
    directions = [[2.0, -1.0, 2.0], [-1.0, -1.0, -2.0], [-3.0, 3.0, -2.0]]
    document: Document = {
        "M": [[3.123, -0.5, 0.0], [-0.5, 0.8668, -0.25], [0.0, -0.25, 1.2683]],
        "K": np.zeros((3, 3)).tolist(),
        "constraints": [
            {"dofs": [0, 1, 2], "weights": w, "lower": None, "upper": 0.0, "restitution": 0.0}
            for w in directions
        ],
        "x": [0.0] * 3, "v": [-1.985, -1.957, -0.634], "t": [2.0**-40], "t_end": 2.0**-40,
    }  # fmt: skip
    try:
        result = solve(document)
    except ConvergenceError as error:  # three directions that rest are one too many of them
        assert "depend on one another" in str(error)  # noqa: PT017
    else:
        assert result.v is not None
        free, M = np.array([-4.0, -2.0, 3.0]), np.array(document["M"])
        assert np.abs(np.array(directions) @ free).max() == 0.0
        kept = (free @ M @ document["v"]) / (free @ M @ free)
        assert np.abs(result.v[0] - kept * free).max() < 1e-9


def _row(M: list[float], K: list[float], k: list[float], gaps: list[float]) -> Document:
    """Return bodies in a row, of which the first one strikes, and the last one too."""
    n = len(M)
    constraints = [
        {"dofs": [i, i + 1], "weights": [-1.0, 1.0], "lower": gap, "upper": None, "restitution": r}
        for i, (gap, r) in enumerate(zip(gaps, k, strict=True))
    ]
    return {"M": np.diag(M).tolist(), "K": np.diag(K).tolist(), "x": [0.0] * n,
            "constraints": constraints}  # fmt: skip


@pytest.mark.parametrize(("k", "gap", "speed"), [(1.0, 1e-9, -0.3), (0.5, 0.0, -1.0)])
def test_what_stays_beside_a_wall_by_less_than_rounding_makes_an_impact_uncertain(
    k: float, gap: float, speed: float
) -> None:
    """Two bodies that stick by k = 0 are 1e-27 apart when a third one strikes: no contact."""
    M = [1.25, 0.25, 7.31]
    document = _row(M, [4.0 * m for m in M], [0.0, k], [1e-9, gap])
    document |= {"v": [1.0, 0.0, speed], "t": [0.2, 0.8], "t_end": 1.0}
    histories.checked(document)
    result = solve(document)
    assert result.error_predictable_until < 1e-8
    assert result.impact_time is not None
    assert result.impact_time[0] < result.error_predictable_until
