"""Motions that integrators are compared on: their references, their judge, and who is first."""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from pathlib import Path

import mpmath
import numpy as np
import pytest
import scipy.linalg

from benchmarks.peers import ahead, cases, integrators, ours, siconos
from benchmarks.peers.ahead import PREPARED, WHOLE, Entry
from benchmarks.peers.cases import Case
from benchmarks.peers.integrators import Point
from benchmarks.peers.scene import Outcome, Scene, acceleration
from tests.benchmarks import reference, soft_reference
from vibroimpact_solvers import presets
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.time_history import Harmonic, Power


def test_the_reference_finds_the_impacts_of_the_oscillator() -> None:
    """Their times are known in closed form: twice arctan(1/u) from wall to wall."""
    case = cases.oscillator()
    found = reference.followed(replace(case.scene, t_end=20.0))
    t, speed, expected = math.asin(0.2), math.sqrt(24.0), []
    while t < 20.0:
        expected.append(t)
        speed *= 0.95
        t += 2.0 * math.atan(1.0 / speed)
    np.testing.assert_allclose(found.times, expected, rtol=1e-14)


def test_the_reference_knows_damping_and_loads() -> None:
    """Walls out of reach: the motion is that of a matrix exponential."""
    K, C = np.array([[2.0, -1.0], [-1.0, 2.0]]), 0.1 * np.eye(2)
    system = System(
        SymmetricMatrix.diagonal([1.0, 1.0]),
        SymmetricMatrix.dense(K),
        (Constraint.at(0, 100.0),),
        C=SymmetricMatrix.dense(C),
    )
    state, load = np.array([0.1, -0.2, 0.5, 0.3]), Harmonic(1, 0.7, 1.3, 0.4)
    found = reference.followed(Scene(system, state, 7.0, (load,)))
    # The load is a pair that turns beside the structure.
    A = np.zeros((6, 6))
    A[:2, 2:4], A[2:4, :2], A[2:4, 2:4] = np.eye(2), -K, -C
    A[3, 4], A[4, 5], A[5, 4] = 0.7, -1.3, 1.3
    start = np.concatenate([state, [math.cos(0.4), math.sin(0.4)]])
    assert found.times == ()
    np.testing.assert_allclose(found.state, (scipy.linalg.expm(7.0 * A) @ start)[:4], rtol=1e-13)


def test_the_soft_reference_follows_a_spring() -> None:
    """A limiter with exponent 1 is one more spring."""
    system = presets.two_mass([Constraint.at(0, 0.5)], 1.0)
    state = np.array([0.1, 0.0, 1.0, 0.4])
    found = soft_reference.followed(Scene(system, state, 5.0, limiter=Power(1.0, 3.0, 0.8)))
    K = system.K.to_dense() + np.diag([3.0 / (0.8 * 0.5), 0.0])
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-K, np.zeros((2, 2))]])
    with mpmath.workdps(30):
        expected = mpmath.expm(5 * mpmath.matrix(A.tolist())) * mpmath.matrix(state.tolist())
    np.testing.assert_allclose(found, np.array(expected.tolist(), dtype=float)[:, 0], rtol=1e-14)


def test_the_soft_reference_keeps_the_energy() -> None:
    system = presets.two_mass([Constraint.at(0, 0.5)], 1.0)
    state, law = np.array([0.0, 0.0, 1.0, 0.4]), Power(17.0, 1.0, 1.0)
    end = soft_reference.followed(Scene(system, state, 6.0, limiter=law))

    def energy(y: np.ndarray) -> float:
        x, v = y[:2], y[2:]
        stored = float(law.potential(x[:1], law.sizes(system)))
        return float(0.5 * v @ v + 0.5 * x @ (system.K @ x)) + stored

    assert energy(end) == pytest.approx(energy(state), rel=1e-14)


@pytest.mark.parametrize("case", [cases.driven(), cases.two_limiters()], ids=lambda one: one.name)
def test_stored_answers_of_rigid_walls(case: Case) -> None:
    exact = reference.followed(case.scene)
    times, state = cases._exact(case.name)
    np.testing.assert_allclose(exact.times, times, rtol=1e-15)
    np.testing.assert_allclose(exact.state, state, rtol=1e-15)


def test_stored_answer_of_soft_limiters() -> None:
    _, state = cases._exact("S")
    np.testing.assert_allclose(soft_reference.followed(cases.soft().scene), state, rtol=1e-15)


def test_peers_get_the_forces_of_soft_limiters() -> None:
    system = presets.two_mass([Constraint((0,), (1.0,), 0.4, 0.5)], 1.0)
    law = Power(3.0, 2.0, 1.0)
    rate = acceleration(Scene(system, np.zeros(4), 1.0, limiter=law))
    for x in (-0.3, 0.3):
        y = np.array([x, 0.0, 0.0, 0.0])
        push = law.forces(y[:1], law.sizes(system))[0]
        assert rate(0.0, y)[0] == pytest.approx(-2.0 * x + push, rel=1e-14)


def test_ours_and_scipy_agree_on_the_driven_masses() -> None:
    scene = replace(cases.driven().scene, t_end=20.0)
    exact = reference.followed(scene)
    assert len(exact.times) > 10
    for found in (
        ours.whole(scene),
        ours.prepared(scene)(),
        integrators.PEERS["scipy DOP853"].prepare(scene)(scene, 1e-12),
    ):
        np.testing.assert_allclose(found.times, exact.times, rtol=0.0, atol=1e-10)
        np.testing.assert_allclose(found.state, exact.state, rtol=0.0, atol=1e-10)


def test_a_ladder_is_climbed_again_with_short_steps_where_impacts_are_missed() -> None:
    case = cases.oscillator()
    scene = replace(case.scene, t_end=3.0)
    exact = reference.followed(scene)
    missed = [3, 0]  # as if the first run had missed some
    points = list(
        integrators.ladder(
            "scipy DOP853", scene, lambda found: missed.pop(0) if missed else 0, step=0.02
        )
    )
    assert len(points) == 1 + len(integrators.PEERS["scipy DOP853"].tolerances)
    assert ["steps ≤ 0.02" in point.setting for point in points[:3]] == [False, True, False]
    np.testing.assert_allclose(points[-1].outcome.times, exact.times, atol=1e-12)
    capped = list(integrators.ladder("scipy DOP853", scene, lambda found: 0, cap=0.0))
    assert len(capped) == 1


def outcome(count: int, state: float = 1.0) -> Outcome:
    return Outcome(tuple(map(float, range(1, count + 1))), np.array([state]))


def test_missing_impacts_leave_no_error() -> None:
    scene = Scene(presets.oscillator([Constraint.at(0, 1.0)], 1.0), np.array([0.0, 2.0]), 1.0)
    case = Case("X", "three impacts", scene, 3, lambda found: abs(float(found.state[0]) - 1.0))
    assert case.judged(outcome(3, 1.5)) == (0, 0.5)
    assert case.judged(outcome(4, 1.0)) == (0, 1e-17)
    missed, error = case.judged(outcome(1))
    assert missed == 2
    assert math.isnan(error)
    assert math.isnan(case.judged(outcome(3, math.inf))[1])


def entry(name: str, seconds: float, error: float) -> Entry:
    return Entry(name, Point("–", outcome(0), seconds), 0, error)


def test_the_fastest_peer_that_is_as_accurate_leads() -> None:
    found = [
        entry(PREPARED, 1.0, 1e-10),
        entry(WHOLE, 2.0, 1e-10),
        entry("coarse", 0.5, 1e-4),
        entry("fine", 8.0, 1e-13),
        entry("misses", 0.1, math.nan),
    ]
    leaders = list(ahead.leaders(found))
    assert [leader.level for leader in leaders] == [1e-3, 1e-6, 1e-9, 1e-12, 4e-13]
    assert [leader.is_best for leader in leaders] == [False] * 4 + [True]
    names = [leader.peer.name for leader in leaders if leader.peer]
    assert names == ["coarse", "fine", "fine", "fine", "fine"]
    assert [leader.times[WHOLE] for leader in leaders] == [0.25, 4.0, 4.0, 0.0, 0.0]
    assert [leader.times[PREPARED] for leader in leaders] == [0.5, 8.0, 8.0, 0.0, 0.0]


def test_where_no_peer_is_as_accurate_there_is_no_ratio() -> None:
    found = [entry(WHOLE, 2.0, 1e-14), entry("coarse", 0.5, 1e-4)]
    *_, best = ahead.leaders(found)
    assert best.peer is None
    assert best.times == {PREPARED: None, WHOLE: None}


def test_the_ball_comes_to_rest() -> None:
    case = cases.ball()
    missed, error = case.judged(ours.whole(case.scene))
    assert missed == 0
    assert error < 1e-14
    with mpmath.workdps(30):
        half = mpmath.sqrt(2 / mpmath.mpf(9.81))
        bounces = [2 * half * mpmath.mpf(0.9) ** k for k in range(1, 400)]
        last = float(half + mpmath.fsum(bounces))
    assert case.error(Outcome((last,), np.zeros(2))) < 1e-15
    assert case.error(Outcome((last,), np.array([-0.3, 0.0]))) == 0.3


class TestSiconos:
    def test_without_its_python_it_is_not_there(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(siconos, "PYTHON", Path("/nowhere/python3"))
        monkeypatch.setattr(siconos, "version", siconos.version.__wrapped__)
        assert siconos.version() is None
        assert "Siconos, event-driven" not in integrators.installed()
        there, _, missing = integrators.settings().partition("not installed: ")
        assert "Siconos" in missing
        assert "Siconos" not in there

    def test_runs_before_one_that_ends_the_process_are_kept(
        self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
    ) -> None:
        worker = tmp_path / "worker.py"
        worker.write_text(
            "import json, sys\n"
            "request = json.load(sys.stdin)\n"
            "assert request['walls'] == [[0, 1.0, 1.0, 0.95], [0, -1.0, 1.0, 0.95]]\n"
            "print('a banner')\n"
            "run = {'times': [0.5], 'state': request['state'], 'seconds': 0.1, 'end': ''}\n"
            "print(json.dumps({'setting': 0.001, **run}), flush=True)\n"
            "sys.exit('out of luck')\n"
        )
        monkeypatch.setattr(siconos, "PYTHON", Path(sys.executable))
        monkeypatch.setattr(siconos, "_WORKER", worker)
        case = cases.oscillator()
        runs = list(siconos.runs("Siconos, event-driven", case.scene, 1.0))
        assert [label for label, _, _ in runs] == ["0.001", "–"]
        assert runs[0][1].times == (0.5,)
        assert runs[0][2] == 0.1
        assert runs[1][1].end == "fails: out of luck"
        assert case.missed(runs[1][1]) == 100

    @pytest.mark.skipif(siconos.version() is None, reason="Debian's python3-siconos is not there")
    def test_it_follows_the_oscillator(self) -> None:
        case = cases.oscillator()
        scene = replace(case.scene, t_end=5.0)
        exact = reference.followed(scene)
        for variant, near in (("Siconos, time stepping", 1e-2), ("Siconos, event-driven", 1e-9)):
            *_, (_, found, _) = siconos.runs(variant, scene, 1.0)
            np.testing.assert_allclose(found.times, exact.times, atol=near)
