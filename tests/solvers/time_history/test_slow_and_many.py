"""Impacts that are slow, loads that are, and impacts that are many, beside the reference."""

from __future__ import annotations

from typing import Any

import pytest

from tests.truth import histories
from tests.truth.histories import checked
from vibroimpact_solvers import time_history
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.time_history import run


def wall(dof: int, gap: float, restitution: float = 1.0) -> dict[str, Any]:
    return {
        "dofs": [dof], "weights": [1.0], "lower": gap, "upper": gap, "restitution": restitution
    }  # fmt: skip


@pytest.mark.parametrize("speed", [7.6e-9, 1e-6])
def test_a_start_at_a_wall_strikes_it_however_slow(speed: float) -> None:
    document = {
        "M": [[2.3]], "K": [[3.1]], "constraints": [wall(0, 1.0, 0.2)], "x": [1.0], "v": [speed],
        "t": [0.9], "t_end": 2.0,
    }  # fmt: skip
    report = checked(document)
    problem = histories.problem_of(document)
    result = time_history.solve(problem, time_history.plan(problem))
    assert result.count_impacts == 1
    assert result.impact_velocity[0] == pytest.approx(speed, rel=1e-7)
    assert result.error_condition < 1e3  # its speed is not lost in the rounding of its place
    assert report.counts["horizon at the end"] == 1


@pytest.mark.needs("compiled kernels")
def test_roundings_of_many_short_motions_do_not_add_up() -> None:
    document = {
        "M": [[2.823949671386963]], "K": [[3.690100733003918]], "C": [[0.15998070361727434]],
        "constraints": [wall(0, 0.0018778111014193023)], "x": [0.0], "v": [0.7869548446394787],
        "t": [3.4], "t_end": 3.5,
    }  # fmt: skip
    report = checked(document)
    assert min(report.ratios["x"]) > 10.0


@pytest.mark.parametrize("frequency", [3e-9, 3e-8, 3e-7])
def test_a_load_that_hardly_turns_moves_a_free_body(frequency: float) -> None:
    document = {
        "M": [[0.6, 0.0], [0.0, 0.6]], "K": [[2.0, -2.0], [-2.0, 2.0]],
        "constraints": [wall(0, 1.0, 0.9)], "x": [0.2, 0.0], "v": [-0.1, -4.0],
        "load": [[1, -2.0, frequency, 0.7]], "t": [0.3, 0.9], "t_end": 0.92,
    }  # fmt: skip
    checked(document)


def test_contacts_without_end_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Coordinates are pressed to their walls, ever harder, and come off, ever again."""
    monkeypatch.setattr(run, "_MOST_AFTERWARDS", 3)
    document = {
        "M": [
            [1.0, 0.2483732948876099, -0.192139347115519, 0.1429822697935119],
            [0.2483732948876099, 0.8148951695026524, 0.004524808236019533, -0.12039433624993323],
            [-0.192139347115519, 0.004524808236019533, 0.3238722544159588, -0.18579341205555022],
            [0.1429822697935119, -0.12039433624993323, -0.18579341205555022, 0.7881281621847378],
        ],
        "K": [
            [0.2919619943135904, -0.13182672066662382, 0.19266717263907127, -0.42015700417713325],
            [-0.13182672066662382, 0.10574095839428639, -0.09700275693650706, 0.16631509047360202],
            [0.19266717263907127, -0.09700275693650706, 0.3695888683921437, -0.4160865973129312],
            [-0.42015700417713325, 0.16631509047360202, -0.4160865973129312, 0.9999999999999999],
        ],
        "constraints": [
            wall(2, 1.0, 0.0),
            {"dofs": [3, 2], "weights": [1.0, 0.5], "lower": 1.0, "upper": 1.0, "restitution": 1.0},
        ],
        "x": [-0.10418719367192147, -0.1561382163628872, 0.12880698552710795, 0.11421755562381342],
        "v": [-2.527028318255666, -0.3390744971322721, -1.2378623938342337, -1.726143516435006],
        "t": [8.600685423566468], "t_end": 14.869830075986284,
    }  # fmt: skip
    problem = histories.problem_of(document)
    with pytest.raises(ConvergenceError, match=r"planned; the motion is predictable until 2\.78"):
        time_history.solve(problem, time_history.plan(problem))


@pytest.mark.needs("compiled kernels")
def test_what_rattles_beside_a_contact_is_followed_by_the_compiled_loop(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One mass rests at its wall, while the next one strikes some thousand times.

    Each impact was answered outside of the loop, in some 400 times the time.
    """
    monkeypatch.setattr(run, "_MOST_EVENTS", 10)
    document = {
        "M": [[1.0, 0.0], [0.0, 1.0]], "K": [[2.0, -1.0], [-1.0, 2.0]], "force": [3.0, 0.0],
        "constraints": [wall(0, 1.0, 0.2), wall(1, 4e-4)],
        "x": [1.0, 0.0], "v": [0.0, 0.3], "t": [0.1, 1.0, 4.0], "t_end": 4.0,
    }  # fmt: skip
    assert checked(document).counts["horizon at the end"] == 1
    problem = histories.problem_of(document)
    assert time_history.solve(problem, time_history.plan(problem)).count_impacts > 1_000


def test_a_return_to_the_wall_that_was_left_slowly() -> None:
    """It is taken further from the wall than rounding, which is part of the error."""
    document = {
        "M": [[2.671895874183731]], "K": [[0.873283319507529]],
        "constraints": [wall(0, 1.0, 0.6465106373308172)], "x": [1.0],
        "v": [-2.0097667347267126e-08], "force": [1.4285376433425925],
        "load": [[0, -0.5572835579526032, 1.1142081793532317, -0.021342854093060915]],
        "t": [0.11620019507653453, 0.7546337344122852, 4.466526832049473, 5.9681707866925,
              6.335617770603266, 8.385673045759471], "t_end": 13.282341200981824,
    }  # fmt: skip
    checked(document)


def test_displacements_at_rest_are_rounded() -> None:
    document = {
        "M": [[2.575403178490275]], "K": [[0.0]], "C": [[0.02196172874832835]],
        "constraints": [{**wall(0, 0.3906511047150643), "lower": None}],
        "x": [0.3906511047150643], "v": [0.0], "force": [0.6365874152858909],
        "t": [1.0890648512214933], "t_end": 3.248284452346807,
    }  # fmt: skip
    checked(document)
