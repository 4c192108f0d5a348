"""Errors of contacts, beside closed forms and the reference."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from tests.truth import histories
from vibroimpact_solvers import presets, spectrum
from vibroimpact_solvers import time_history as th
from vibroimpact_solvers.arrays import EPS
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.time_history import planning
from vibroimpact_solvers.time_history.basis import COLUMNS
from vibroimpact_solvers.time_history.history import new_history
from vibroimpact_solvers.time_history.run import Arrays, Run
from vibroimpact_solvers.time_history.structure import Structure

CONTACTS = frozenset({"contacts", "impacts"})


def solve(system: System, x: float, v: float, t_end: float, **fields: Any) -> th.Result:
    state = th.State(np.array([x]), np.array([v]))
    problem = th.Problem(system, state, t_end, outputs=CONTACTS, **fields)
    return th.solve(problem, th.plan(problem))


def within(stated: Any, error: Any, true: Any, most: float) -> None:
    """Check that numbers are within their errors, and these within a limit."""
    stated, error, true = map(np.asarray, (stated, error, true))
    assert (np.abs(stated - true) <= error).all()
    assert (error <= most).all()


@pytest.mark.parametrize("restitution", [0.0, 0.3, 0.9])
def test_the_rest_of_a_ball(restitution: float) -> None:
    ball = presets.bouncing_ball([Constraint((0,), (1.0,), 0.0, None, restitution)])
    result = solve(ball, 1.0, 0.0, 12.0)
    fall = math.sqrt(2.0 / 9.81)
    rest = fall * (1.0 + restitution) / (1.0 - restitution)
    within(result.contact_rest, result.error_contact_rest, [rest], 1e-11)
    impulse = 9.81 * (12.0 - rest)
    within(result.contact_impulse, result.error_contact_impulse, [impulse], 1e-10)
    assert result.error_contact_stop is not None
    np.testing.assert_array_equal(result.error_contact_stop, 0.0)  # it is that of the motion


def test_velocities_while_bounces_last_are_unknown_by_the_first_of_them() -> None:
    ball = presets.bouncing_ball([Constraint((0,), (1.0,), 0.0, None, 0.9)])
    known = solve(ball, 1.0, 0.0, 12.0)
    assert known.contact_rest is not None
    assert known.contact_start is not None
    start = float(known.contact_start[0])
    lasts = float(known.contact_rest[0]) - start
    leaves = 9.81 * 0.1 * lasts / 2.0
    t = np.array([start - lasts, start + 0.01 * lasts, start + 2.0 * lasts])
    problem = th.Problem(
        ball, th.State(np.array([1.0]), np.array([0.0])), 12.0, t=t, outputs=frozenset({"v"})
    )
    result = th.solve(problem, th.plan(problem))
    assert result.error_v is not None
    before, between, after = result.error_v[:, 0].tolist()
    assert 0.9 * leaves < between < 1.1 * leaves
    assert max(before, after) < 1e-3 * between


def test_a_chatter_leaves_what_is_known_of_the_motion() -> None:
    """The roundings of a hundred low bounces are not those of a state each."""
    wall = {"dofs": [0], "weights": [1.0], "lower": None, "upper": 0.3, "restitution": 0.8}
    document = {
        "M": [[1.0, 0.0], [0.0, 2.0]], "K": [[3.0, -1.0], [-1.0, 2.0]], "constraints": [wall],
        "x": [0.0, 0.1], "v": [1.0, 0.0], "force": [2.5, 0.3], "t": [4.0, 12.0, 30.0],
        "t_end": 30.0,
    }  # fmt: skip
    report = histories.checked(document)
    assert report.ratios["contact rest"]
    problem = histories.problem_of(document)
    result = th.solve(problem, th.plan(problem))
    assert result.count_impacts > 50
    assert result.error_x is not None
    assert result.error_x.max() < 1e-11
    assert result.error_condition < 1e6


def test_a_driven_mass_at_its_wall() -> None:
    """x'' + x = F cos(w t + phase), k = 0: it leaves where the force of the wall vanishes."""
    gap, F, w, phase = 0.3, 0.8, 0.4, 0.2
    system = presets.oscillator([Constraint((0,), (1.0,), None, gap, 0.0)], 1.0)
    result = solve(system, gap, 0.0, 60.0, load=(th.Harmonic(0, F, w, phase),))
    assert result.contact_rest is not None
    assert result.contact_stop is not None
    assert result.error_contact_start is not None
    assert result.error_contact_start[0] == 0.0  # it starts there
    ends = (2.0 * math.pi * np.arange(4) + math.acos(gap / F) - phase) / w
    later = result.contact_stop < 59.9
    turn = np.round((result.contact_stop - ends[0]) * w / (2.0 * math.pi)).astype(int)
    assert result.error_contact_stop is not None
    within(
        result.contact_stop[later], result.error_contact_stop[later], ends[turn[later]], 1e-12
    )  # fmt: skip


def test_contacts_beyond_what_is_predictable_have_no_error() -> None:
    system = presets.oscillator([Constraint((0,), (1.0,), None, 0.3, 0.0)], 1.0)
    load = (th.Harmonic(0, 0.8, 0.4, 0.2),)
    result = solve(system, 0.3, 0.0, 60.0, load=load, tolerance=1e-15)
    assert result.error_predictable_until < 20.0
    assert result.contact_stop is not None
    assert result.error_contact_stop is not None
    late = result.contact_stop >= result.error_predictable_until
    assert late.any()
    assert np.isinf(result.error_contact_stop[late]).all()


def test_what_strikes_together_within_rounding_does_not_rest_at_its_own_time() -> None:
    """Two coordinates bounce, one 5e-11 after the other: lower bounces are taken together."""
    wall = {"lower": 1.0, "upper": 1.0, "restitution": 0.5, "weights": [1.0]}
    document = {
        "M": [[1.0, 0.0], [0.0, 1.0]], "K": [[0.0, 0.0], [0.0, 0.0]],
        "constraints": [{"dofs": [0], **wall}, {"dofs": [1], **wall}], "x": [0.0, 0.0],
        "v": [2.5, 2.5000000000288085], "force": [1.0, 1.0], "t": [3.025207192526133],
        "t_end": 13.208843398958221,
    }  # fmt: skip
    report = histories.checked(document)
    assert report.ratios["contact rest"]


@pytest.mark.parametrize("count", [1, 7])
def test_contacts_that_last_through_windows(monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    """The errors of what ends in another window than it begins are those of one window."""
    monkeypatch.setattr(planning, "SECONDS", 1.0 if count == 1 else 1e-9)
    monkeypatch.setattr(planning, "_MOST", count)
    system = presets.oscillator([Constraint((0,), (1.0,), None, 0.3, 0.4)], 1.0, 0.05)
    result = solve(system, 0.0, 0.0, 80.0, load=(th.Harmonic(0, 0.8, 0.1),))
    assert result.contact_stop is not None
    assert result.contact_stop.size >= 2
    for name in ("rest", "stop", "impulse"):
        errors = getattr(result, f"error_contact_{name}")
        assert (errors >= 0.0).all()
        assert (errors < 1e-9).all()
    one, two = result.contact_rest, result.contact_stop
    assert one is not None
    # On the wall its force is F cos(w t) - gap.
    given = (np.sin(0.1 * two) - np.sin(0.1 * one)) * 8.0 - 0.3 * (two - one)
    within(result.contact_impulse, result.error_contact_impulse, given, 1e-9)


ONE_LEFT_SLOWLY = {
    "M": [[1.431363195288533, 0.0], [0.0, 0.6213949993772305]],
    "K": [[0.8964869454073041, -0.8964869454073041], [-0.8964869454073041, 0.8964869454073041]],
    "constraints": [
        {"dofs": [1], "weights": [1.0], "lower": 1.706968911021174, "upper": 1.706968911021174,
         "restitution": 0.6534436384673323},
        {"dofs": [0], "weights": [1.0], "lower": 1.0, "upper": 0.1377513045277526,
         "restitution": 0.0},
    ],
    "x": [0.0, 0.0], "v": [1.255250850571561, 1.176080368616666], "t": [2.6653756586479593],
    "t_end": 23.425269539560023,
}  # fmt: skip
SLIDING = {
    "M": [[1.0]], "K": [[0.0]], "C": [[0.001646278934388742]], "force": [-0.14372544433399792],
    "constraints": [{"dofs": [0], "weights": [1.0], "lower": 0.0027457802918011815,
                     "upper": 0.0027457802918011815, "restitution": 0.7131349702831253}],
    "x": [0.0], "v": [0.09278857100286654], "t": [4.4112731857643315], "t_end": 5.142266241179644,
}  # fmt: skip

TAKING_TURNS = {
    "M": [[0.8072049317170634, 2.0500720542996576e-05], [2.0500720542996576e-05, 1.0]],
    "K": [[-0.25438036026819155, -0.04108748752231359], [-0.04108748752231359, 0.4215986867789041]],
    "constraints": [
        {"dofs": [1, 0], "weights": [1.0, 0.7], "lower": 0.019758982053543088,
         "upper": 0.019758982053543088, "restitution": 0.6035116330704947},
        {"dofs": [0], "weights": [1.0], "lower": 0.001069718551784564,
         "upper": 0.001069718551784564, "restitution": 0.20912695766324715},
    ],
    "x": [0.0, 0.0], "v": [-0.45864803272613314, -0.14350554473516772],
    "force": [0.1576485600975042, 0.10949598386490624],
    "load": [[1, -0.006393696178718594, 0.7689440298787962, 1.4330682438826674],
             [1, -0.12943705343073666, 0.563883188326063, 0.40343318750936863]],
    "t": [2.6144], "t_end": 2.6144,
}  # fmt: skip

WEAKLY_PRESSED = {
    "M": [[1.5519309659545757, 0.0], [0.0, 0.3078038407135598]],
    "K": [[0.6943359375, -0.6943359375], [-0.6943359375, 0.6943359375]],
    "constraints": [
        {"dofs": [0], "weights": [1.0], "lower": None, "upper": 1.155427069235819,
         "restitution": 0.23392799483631804},
        {"dofs": [1], "weights": [1.0], "lower": 4.464348982639434, "upper": 4.464348982639434,
         "restitution": 0.9095739535545369},
    ],
    "x": [-0.04674210131464956, 0.16529101518133898],
    "v": [0.7848173308816944, -0.13437383937222483], "t": [8.189974808857187],
    "t_end": 12.590367593692557,
}  # fmt: skip
SLOW_AT_ITS_WALL = {
    "M": [[1.0, 0.06798041054598351], [0.06798041054598351, 0.5315775340953914]],
    "K": [[0.7764153868229415, -0.4455603468342714], [-0.4455603468342714, 1.0]],
    "constraints": [
        {"dofs": [1], "weights": [1.0], "lower": 0.5219909873322802, "upper": 0.5219909873322802,
         "restitution": 0.9414443137922237},
        {"dofs": [0], "weights": [1.0], "lower": 1.0, "upper": 1.0, "restitution": 0.0},
    ],
    "x": [0.0, 0.5219909873322802], "v": [-1.148952605668414, -5.4438373296348895e-09],
    "force": [-1.0420584256805807, 1.074664605821874],
    "load": [[0, 0.10116454998252253, 1.545238904801438, -2.400066760119428]],
    "t": [0.470321577408048, 6.759813520701773, 7.834726781355846], "t_end": 10.67420810493639,
}  # fmt: skip


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize(
    "document",
    [ONE_LEFT_SLOWLY, SLIDING, TAKING_TURNS, WEAKLY_PRESSED, SLOW_AT_ITS_WALL],
    ids=["slow", "sliding", "turns", "weak", "slow at its wall"],
)
def test_rests_whose_error_was_stated_too_small(document: dict[str, Any]) -> None:
    """An impact at 6e-5 was taken 1e-14 from its wall; roundings of low bounces beside drag.

    Contacts that take turns: displacements from a large deflection are rounded at each turn.
    A force that is weak, and changes by much while bounces last; k = 0, with a speed that is
    rounding after an impact.
    """
    report = histories.checked(document)
    assert report.ratios["contact rest"]


@pytest.mark.parametrize("apart", [1e-2, 1e-3, 1e-4, 1e-5])
def test_what_rests_at_limiters_that_are_nearly_the_same_is_where_they_are(apart: float) -> None:
    """Two masses pressed to two walls, whose directions hardly differ."""
    walls = Fraction(0.3), Fraction(0.3 + 0.7 * apart)
    rows = [[Fraction(1.0), Fraction(0.4)], [Fraction(1.0), Fraction(0.4 + apart)]]
    # Of w x = c for both.
    second = (walls[1] - walls[0]) / (rows[1][1] - rows[0][1])
    true = [walls[0] - rows[0][1] * second, second]
    limiters = [
        Constraint((0, 1), (float(a), float(b)), None, float(wall), 0.0)
        for (a, b), wall in zip(rows, walls, strict=True)
    ]
    K = SymmetricMatrix.dense([[0.3, 0.05], [0.05, 0.2]])
    # Pressed along both, by what is between their directions.
    force = np.array([3.0, 3.0 * (0.4 + 0.5 * apart)]) + K @ np.array([float(x) for x in true])
    system = System(SymmetricMatrix.diagonal([1.0, 1.3]), K, tuple(limiters), force=force)
    start = th.State(np.array([float(x) for x in true]), np.zeros(2))
    problem = th.Problem(
        system, start, 2.0, t=np.array([2.0]), outputs=frozenset({"x", "contacts"})
    )
    result = th.solve(problem, th.plan(problem))
    assert result.x is not None
    assert result.error_x is not None
    assert result.contact_rest is not None
    assert result.contact_rest.size == 2
    for x, error, exact in zip(result.x[0].tolist(), result.error_x[0], true, strict=True):
        assert abs(Fraction(x) - exact) <= error
        assert error <= 4.0 * EPS * float(true[1])


def test_roundings_of_different_contacts_have_signs_of_their_own() -> None:
    system = System(
        SymmetricMatrix.diagonal([1.0, 1.0, 1.0]), SymmetricMatrix.diagonal([1.0, 2.0, 3.0]),
        (Constraint.at(0, 1.0), Constraint.at(1, 1.0)),
    )  # fmt: skip
    x = np.array([1.0, 0.9, 0.8])
    problem = th.Problem(system, th.State(x, 0.1 * x), 1.0, t=np.array([1.0]))
    structure = Structure.of(system, spectrum.Method.DIAGONAL, 1.0)
    seen = set()
    every = [(0, -1)], [(0, 1)], [(1, -1)], [(1, 1)], [(0, 1), (1, 1)], [(0, -1), (1, 1)], []
    for contacts in every:
        run = Run(structure, Arrays(structure, COLUMNS, 3), problem, new_history(problem, 1))
        run.configuration = structure.configuration(frozenset(contacts))
        run.Z = np.ones((1 + COLUMNS, 2, run.configuration.basis.pairs))
        seen.add(np.sign([dx for dx, _ in run._roundings()]).tobytes())
    assert len(seen) == len(every)


def _column(M: list[float], lower: list[float], k: list[float], v: list[float]) -> dict[str, Any]:
    """Return bodies one above the other, above a floor, under their weights."""
    n = len(M)
    constraints = [
        {"dofs": [i - 1, i] if i else [0], "weights": [-1.0, 1.0] if i else [1.0],
         "lower": lower[i], "upper": None, "restitution": k[i]}
        for i in range(n)
    ]  # fmt: skip
    return {"M": np.diag(M).tolist(), "K": np.zeros((n, n)).tolist(), "constraints": constraints,
            "force": [-9.81 * m for m in M], "x": [0.0] * n, "v": v}  # fmt: skip


@pytest.mark.parametrize("k", [0.9, 1.0])
def test_what_a_contact_of_unknown_end_gives_is_unknown(k: float) -> None:
    """Bodies that touch and fall together: rounding tells when they part, and who is struck."""
    document = _column([5.66, 5.28, 4.5, 0.17], [0.5, 1e-9, 0.0, 0.0], [k] * 4, [0.5] * 4)
    document |= {"t": [0.2, 0.3, 0.6], "t_end": 1.0}
    report = histories.checked(document)
    assert report.counts["contact impulse: no error stated"] == 1


def test_a_blow_at_the_end_of_a_contact_belongs_to_it_or_not() -> None:
    """The contact ends at the horizon, within its error: what was given then is not known."""
    document = _column([0.19, 4.96, 5.67], [0.0] * 3, [0.9, 0.0, 1.0], [0.5, 0.0, 0.5])
    lid = {"dofs": [2], "weights": [1.0], "lower": None, "upper": 0.5, "restitution": 0.5}
    document["constraints"].append(lid)
    document |= {"K": np.diag([0.0, 1.0, 1.0]).tolist(), "t": [0.5, 1.0, 1.7], "t_end": 2.0}
    report = histories.checked(document)
    assert report.counts["contact impulse: no error stated"] == 1


def test_a_body_rests_on_one_that_rests_and_not_on_one_that_falls_beside_it() -> None:
    """Without restitution both rest at once: the force between them begins with that of the floor.

    A speed that was rounding took 0.025 to vanish, by the force of two bodies that fall together.
    """
    document = _column([1.39, 0.67], [0.0, 0.0], [0.0, 0.0], [-1.0, 0.0])
    document |= {"K": np.diag([0.0, 1.0]).tolist(), "t": [0.3, 1.0], "t_end": 2.0}
    report = histories.checked(document)
    assert max(report.ratios["contact rest"]) < 1e12
