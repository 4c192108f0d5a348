"""Time histories where numbers go wrong: right to the stated error, or refused with a reason."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest

from tests.solvers.stress import extended
from tests.solvers.stress.modal_motion import Drive, ModalMotion
from tests.solvers.stress.structures import full, springs
from tests.solvers.time_history.reference_motion import ReferenceMotion, Stop
from vibroimpact_solvers import presets, spectrum, time_history
from vibroimpact_solvers.errors import ConvergenceError, ModelError, PlanError
from vibroimpact_solvers.model import Constraint, System
from vibroimpact_solvers.time_history import Harmonic, Problem, Result, State

_EPS = 2.0**-52
RATIOS = [1e-12, 1e-6, 1e6, 1e12]


def solve(system: System, x: Any, v: Any, t_end: float, **more: Any) -> Result:
    problem = Problem(
        system,
        State(np.asarray(x, dtype=float), np.asarray(v, dtype=float)),
        t_end,
        t=np.array([t_end]),
        **{"outputs": frozenset({"x", "v", "impacts", "contacts"}), **more},
    )
    return time_history.solve(problem, time_history.plan(problem))


def check(system: System, x: Any, v: Any, t_end: float, steps: int = 100) -> Result:
    """Follow a motion and compare impacts and the end with extended precision."""
    result = solve(system, x, v, t_end)
    stops = [
        Stop(row, c.upper, c.lower, c.restitution)
        for row, c in zip(
            system.directions(range(len(system.constraints))), system.constraints, strict=True
        )
    ]
    motion = ReferenceMotion(system.M.to_dense().tolist(), system.K.to_dense().tolist(), stops)
    expected, end = motion.follow(x, v, t_end, t_end / steps)
    assert result.impact_time is not None
    assert result.impact_condition is not None
    assert result.x is not None
    assert result.v is not None
    assert result.impact_time.size == len(expected)
    omega = float(
        np.sqrt(
            np.abs(
                np.linalg.eigvals(np.linalg.solve(system.M.to_dense(), system.K.to_dense()))
            ).max()
        )
    )
    for i, (t, constraint, side, speed) in enumerate(expected):
        stated = float(result.impact_condition[i]) * _EPS
        assert result.impact_constraint is not None
        assert result.impact_side is not None
        assert result.impact_velocity is not None
        assert (result.impact_constraint[i], result.impact_side[i]) == (constraint, side)
        if stated < 0.01:
            size = max(abs(float(s)) for s in (*v, speed))
            assert abs(result.impact_velocity[i] - speed) <= 16 * stated * size * (
                1 + omega * t_end
            )
            assert abs(result.impact_time[i] - t) <= 16 * stated * t_end * (1 + size)
    n = system.n
    stated = result.error_condition * _EPS
    if stated < 0.01:
        for found, exact in ((result.x[0], end[:n, 0]), (result.v[0], end[n:, 0])):
            size = max(abs(value) for value in exact) + max(map(abs, x)) + 1e-30
            assert max(
                abs(a - b) for a, b in zip(found, exact, strict=True)
            ) <= 64 * stated * size * (1 + omega * t_end)
    return result


def check_blow(
    system: System,
    blow: float,
    t_end: float,
    step: float,
    drive: Drive | None = None,
    natural: extended.Modes | None = None,
    least: int = 3,
) -> Result:
    """Follow a motion from a blow along the first constraint, driven along it.

    Impacts are compared with those of natural modes in extended precision, as long as the
    stated error leaves digits.
    """
    constraints = system.constraints
    row = system.directions((0,))[0]
    v = blow * system.M.factorize()(row)
    load: tuple[Harmonic, ...] = ()
    if drive is not None:
        load = tuple(
            Harmonic(dof, weight * drive.amplitude, drive.frequency, drive.phase)
            for dof, weight in constraints[0].coordinate
        )
    result = solve(system, np.zeros(system.n), v, t_end, load=load)
    with mpmath.workdps(60):
        natural = natural or extended.modes(system)
        expected = ModalMotion(natural, constraints, drive).follow(blow, t_end, step)
    assert result.count_impacts == len(expected) >= least
    assert result.impact_time is not None
    assert result.impact_constraint is not None
    assert result.impact_side is not None
    assert result.impact_velocity is not None
    assert result.impact_condition is not None
    # What is stated is relative to the state in the energy norm: a speed of it at most.
    fastest = np.sqrt(float(max(1.0, *natural.eigenvalues)))
    speed = max(abs(float(e[3])) for e in expected)
    for i, (t, constraint, side, velocity) in enumerate(expected):
        assert (result.impact_constraint[i], result.impact_side[i]) == (constraint, side)
        stated = float(result.impact_condition[i]) * _EPS
        assert stated < 1e-6
        off = 16.0 * stated * speed * (1.0 + fastest)
        assert abs(result.impact_velocity[i] - velocity) <= off
        assert abs(result.impact_time[i] - t) * abs(velocity) <= off
    return result


class TestRatios:
    @pytest.mark.parametrize("ratio", RATIOS)
    def test_masses(self, ratio: float) -> None:
        system = springs([1.0, ratio], np.ones(3), [Constraint.at(0, 0.5)])
        fast = np.sqrt(2.0 / min(1.0, ratio))
        check(system, [0.0, 0.0], [1.0, 0.3], 12.0 / fast if ratio < 1 else 4.0)

    @pytest.mark.parametrize("ratio", RATIOS)
    def test_stiffnesses(self, ratio: float) -> None:
        system = springs(np.ones(2), [1.0, ratio, 1.0], [Constraint.at(0, 0.5)])
        fast = np.sqrt(2.0 * max(1.0, ratio))
        check(system, [0.0, 0.0], [1.0, 0.3], 12.0 / fast if ratio > 1 else 4.0)


class TestSpectra:
    def test_repeated(self) -> None:
        R = np.linalg.qr(np.random.default_rng(2).standard_normal((4, 4)))[0]
        K = R @ np.diag([1.0, 1.0, 4.0, 4.0]) @ R.T
        constraints = [Constraint.at(1, 0.3, 0.9), Constraint.at(2, 0.1)]
        check_blow(full(np.eye(4), K, constraints), 1.0, 20.0, 0.05)

    def test_clustered(self) -> None:
        R = np.linalg.qr(np.random.default_rng(3).standard_normal((4, 4)))[0]
        K = R @ np.diag([1.0, 1.0 + 1e-13, 1.0 - 1e-10, 4.0]) @ R.T
        constraints = [Constraint.at(1, 0.3, 0.9), Constraint.at(2, 0.1)]
        check_blow(full(np.eye(4), K, constraints), 1.0, 20.0, 0.05)

    @pytest.mark.parametrize("k", [0.9, 1.0])
    def test_rigid_body(self, k: float) -> None:
        """A free chain between walls at its middle."""
        system = springs(np.ones(3), [0.0, 1.0, 1.0, 0.0], [Constraint.at(1, 0.5, k)])
        check_blow(system, 1.0, 20.0, 0.05)

    @pytest.mark.parametrize(("name", "n"), [("closed form", 5000), ("tridiagonal", 1000)])
    def test_thousands(self, name: str, n: int) -> None:
        """No wave has reached an end of 61 masses yet, but for 1e-37 of it."""
        middle, wall = n // 2, (Constraint.at(30, 0.2, 0.9),)
        system = presets.chain(n, [Constraint.at(middle, 0.2, 0.9)])
        if name == "tridiagonal":
            system = springs(np.ones(n), np.ones(n + 1), system.constraints)
        with mpmath.workdps(60):
            natural = extended.chain_modes(presets.chain(61, wall))
        found = check_blow(system, 1.0, 4.0, 0.05, natural=natural)
        assert found.count_impacts < 50


class TestLoads:
    """Harmonic loads from far below to far above the spectrum, and exactly in resonance."""

    @pytest.mark.parametrize("k", [0.8, 1.0])
    @pytest.mark.parametrize("phase", [0.0, 0.4])
    def test_one_mass_exactly_in_resonance(self, k: float, phase: float) -> None:
        system = presets.oscillator([Constraint.at(0, 1.0, k)], 1.0)
        check_blow(system, 1e-3, 40.0, 0.05, Drive(0.3, 1.0, phase), least=5)

    @pytest.mark.parametrize("mode", [0, 5, 12])
    def test_a_chain_in_resonance_to_the_last_bit(self, mode: int) -> None:
        system = presets.chain(13, [Constraint.at(5, 0.2, 0.8)])
        with mpmath.workdps(60):
            natural = extended.chain_modes(system)
        frequency = float(spectrum.spectrum(system).roots[mode])
        drive = Drive(1.0, frequency, 0.3)
        check_blow(system, 0.1, 12.0, 0.04, drive, natural)

    @pytest.mark.parametrize("exponent", [-8, -4, 4, 6])
    def test_frequencies(self, exponent: int) -> None:
        system = springs(np.ones(2), np.ones(3), [Constraint.at(0, 0.2, 0.9)])
        check_blow(system, 1.0, 3.0, 0.05, Drive(0.5, 10.0**exponent, 0.3), least=2)

    def test_slow_and_fast_loads_are_constant_and_nothing(self) -> None:
        """At 1e-8 and 1e8 of the spectrum, below walls that are not reached."""
        system = springs(np.ones(2), np.ones(3), [Constraint.at(0, 9.0)])
        for frequency, size in ((1e-8, 1.0), (1e8, 0.0)):
            load = (Harmonic(0, 0.5, frequency, 0.0),)
            found = solve(system, np.zeros(2), np.zeros(2), 0.5, load=load).x
            t, push = 0.5, 0.5 * size
            # Modes 1 and sqrt(3) of two masses, from rest under a constant push.
            slow, fast = (push * (1 - np.cos(w * t)) / w**2 / 2 for w in (1.0, np.sqrt(3.0)))
            np.testing.assert_allclose(found, [[slow + fast, slow - fast]], atol=2e-15)


class TestWalls:
    @pytest.mark.parametrize("gap", [1e-12, 1e12])
    def test_gaps(self, gap: float) -> None:
        """Everything scales with the gap."""
        system = springs(np.ones(2), np.ones(3), [Constraint.at(0, gap, 0.9)])
        one = springs(np.ones(2), np.ones(3), [Constraint.at(0, 1.0, 0.9)])
        found = solve(system, [0.0, 0.0], [2.0 * gap, 0.5 * gap], 12.0)
        expected = solve(one, [0.0, 0.0], [2.0, 0.5], 12.0)
        assert expected.impact_time is not None
        assert expected.impact_time.size > 2
        np.testing.assert_allclose(found.impact_time, expected.impact_time, rtol=1e-12)
        assert found.x is not None
        assert expected.x is not None
        np.testing.assert_allclose(found.x / gap, expected.x, rtol=1e-10)

    def test_unreachable_walls_are_never_struck(self) -> None:
        system = springs(np.ones(2), np.ones(3), [Constraint.at(0, 1e12)])
        found = check(system, [0.0, 0.0], [1.0, 0.5], 12.0)
        assert found.count_impacts == 0

    @pytest.mark.parametrize("offset", [-1e-9, -1e-12, 1e-12, 1e-9])
    def test_almost_grazing(self, offset: float) -> None:
        """One mass that reaches 1: a wall a hair nearer is struck every half period."""
        system = presets.oscillator([Constraint.at(0, 1.0 + offset)], 1.0)
        found = solve(system, [0.0], [1.0], 20.0)
        assert found.x is not None
        assert found.v is not None
        if offset > 0:
            assert found.count_impacts == 0
            np.testing.assert_allclose(found.x[0, 0], np.sin(20.0), atol=1e-13)
        else:
            with mpmath.workdps(40):
                wall = 1 + mpmath.mpf(offset)
                first = mpmath.asin(wall)
                assert found.impact_time is not None
                assert abs(found.impact_time[0] - first) < 1e-13 / np.sqrt(-offset)
                interval = 2 * first
                count = int(mpmath.floor((20 - first) / interval)) + 1
            assert found.count_impacts == count

    @pytest.mark.parametrize("offset", [-1e-15, 0.0, 1e-15])
    def test_grazing_to_the_last_bit(self, offset: float) -> None:
        """Touches and misses differ by less than rounding: the motion is the same."""
        system = presets.oscillator([Constraint.at(0, 1.0 + offset)], 1.0)
        found = solve(system, [0.0], [1.0], 20.0)
        assert found.x is not None
        # An impact with the speed sqrt(2 1e-15) shortens each half period by 9e-8.
        np.testing.assert_allclose(abs(found.x[0, 0]), abs(np.sin(20.0)), atol=2e-6)
        assert found.error_penetration < 1e-12

    @pytest.mark.parametrize("k", [0.0, 1e-12, 0.5, 1.0 - 1e-12, 1.0])
    def test_restitutions(self, k: float) -> None:
        """Speeds of one mass: k^n of the first, and times between the walls."""
        system = presets.oscillator([Constraint.at(0, 1.0, k)], 1.0)
        found = solve(system, [0.0], [3.0], 8.0)
        assert found.impact_velocity is not None
        assert found.impact_time is not None
        with mpmath.workdps(40):
            u, t, i = mpmath.sqrt(mpmath.mpf(8)), mpmath.asin(mpmath.mpf(1) / 3), 0
            while t < 8:
                assert i < found.count_impacts
                assert abs(abs(found.impact_velocity[i]) / u - 1) < 1e-13
                assert abs(found.impact_time[i] - t) < 1e-13
                u *= mpmath.mpf(k)
                if u < 1e-6:
                    break
                t += 2 * mpmath.atan(1 / u)
                i += 1

    def test_three_struck_in_the_same_moment(self) -> None:
        system = springs(
            np.ones(3), [1.0, 1.0, 1.0, 1.0], [Constraint.at(i, 0.5, 0.8) for i in range(3)]
        )
        x, v = np.full(3, 0.5 - 0.25), np.full(3, 1.0)
        found = solve(system, x, v, 3.0)
        assert found.x is not None
        assert np.isfinite(found.x).all()
        # What is alike at both ends stays alike.
        np.testing.assert_allclose(found.x[0, 0], found.x[0, 2], atol=1e-12)

    @pytest.mark.parametrize("k", [0.7, 1.0])
    def test_three_apart_struck_in_the_same_moments(self, k: float) -> None:
        """Three masses that nothing couples: each moves as if it were alone."""
        constraints = [Constraint.at(i, 1.0, k) for i in range(3)]
        system = full(np.eye(3), np.eye(3), constraints)
        found = solve(system, np.zeros(3), np.full(3, 3.0), 4.0)
        assert found.impact_time is not None
        assert found.impact_constraint is not None
        assert found.impact_velocity is not None
        with mpmath.workdps(40):
            u, t, moments = mpmath.sqrt(mpmath.mpf(8)), mpmath.asin(mpmath.mpf(1) / 3), []
            while t < 4:
                moments.append((t, u))
                u *= mpmath.mpf(k)
                t += 2 * mpmath.atan(1 / u)
        assert found.count_impacts == 3 * len(moments)
        for i, (t, u) in enumerate(moments):
            three = slice(3 * i, 3 * i + 3)
            assert sorted(found.impact_constraint[three]) == [0, 1, 2]
            assert max(abs(found.impact_time[three] - t)) < 1e-13
            assert max(abs(abs(found.impact_velocity[three]) - u)) < 1e-13


class TestMany:
    def test_chatter_ends_at_rest(self) -> None:
        """Infinitely many impacts: t = sqrt(2H/g) (1 + k)/(1 - k)."""
        for k in (0.1, 0.9, 0.999):
            system = presets.bouncing_ball([Constraint((0,), (1.0,), 0.0, None, k)], 9.81)
            exact = np.sqrt(2.0 / 9.81) * (1 + k) / (1 - k)
            found = solve(system, [1.0], [0.0], 1.5 * exact)
            assert found.contact_rest is not None
            assert found.x is not None
            np.testing.assert_allclose(found.contact_rest, [exact], rtol=1e-12)
            np.testing.assert_allclose(found.x, 0.0, atol=1e-12)

    def test_a_hundred_thousand_impacts(self) -> None:
        """Elastic: each half period the same, 2 arcsin(1/v), to the stated error."""
        system = presets.oscillator([Constraint.at(0, 1.0)], 1.0)
        with mpmath.workdps(40):
            first = mpmath.asin(mpmath.mpf(1) / 3)
            count = 100_000
            t_end = float(2 * first * count)
            found = solve(system, [0.0], [3.0], t_end, outputs=frozenset({"impacts"}))
            assert found.impact_time is not None
            assert abs(found.count_impacts - count) <= 1
            exact = first + 2 * first * (count - 2)
            error = abs(found.impact_time[count - 2] - exact)
            assert error <= max(4 * found.error_condition, 4.0 * count) * _EPS * t_end

    def test_ten_million_impacts(self) -> None:
        """Elastic: all energy is there at the end, and the last impact is where it should be."""
        count = 10**7
        with mpmath.workdps(40):
            half = mpmath.asin(mpmath.mpf(1) / 5)
            t_end, last = float(2 * half * count), half * (2 * count - 1)
        system = presets.oscillator([Constraint.at(0, 1.0)], 1.0)
        found = solve(system, [0.0], [5.0], t_end, outputs=frozenset({"impacts"}))
        assert found.count_impacts == count
        assert found.impact_time is not None
        assert found.impact_velocity is not None
        speeds = np.abs(found.impact_velocity)
        assert np.abs(speeds**2 / 24.0 - 1.0).max() < 1e-14
        assert np.abs(np.diff(speeds)).max() < 1e-14
        assert abs(found.impact_time[-1] / last - 1) < 1e-14
        assert abs(found.impact_time[-1] / last - 1) <= found.error_condition * _EPS


class TestRefused:
    @pytest.mark.parametrize("force", [0.0, 0.3])
    def test_millions_of_millions_of_impacts(self, force: float) -> None:
        """At least one in every period of a mass that loses nothing, for ever."""
        constraints = [Constraint((0,), (2.0,), None, 1.0)]
        M, K = np.eye(1), np.eye(1)
        system = full(M, K, constraints, np.array([force]))
        with pytest.raises(PlanError, match="ask for less time"):
            solve(system, [0.0], [3.0], 1e12)
        free = full(M, 0.0 * K, [Constraint.at(0, 1.0)])
        with pytest.raises(PlanError, match="ask for less time"):
            solve(free, [0.0], [3.0], 1e12)

    @pytest.mark.parametrize(("k", "damping"), [(0.9, 0.0), (1.0, 0.01)])
    def test_motions_that_calm_down_are_not(self, k: float, damping: float) -> None:
        system = presets.oscillator([Constraint.at(0, 1.0, k)], 1.0, damping)
        problem = Problem(system, State(np.zeros(1), np.array([3.0])), 1e12)
        assert time_history.plan(problem).steps

    def test_phases_that_are_lost(self) -> None:
        system = presets.oscillator([Constraint.at(0, 1.0)], 1.0)
        load = (Harmonic(0, 0.1, 1.0, 0.0), Harmonic(0, 0.1, 1e16, 0.0))
        with pytest.raises(ModelError, match="more than 1 rad apart") as caught:
            solve(system, [0.0], [0.0], 10.0, load=load)
        assert caught.value.pointer == ("load", 1, "frequency")

    @pytest.mark.parametrize("value", [np.nan, np.inf])
    def test_states_that_are_no_numbers(self, value: float) -> None:
        system = presets.oscillator([Constraint.at(0, 1.0)], 1.0)
        with pytest.raises(ModelError):
            solve(system, [value], [0.0], 1.0)

    @pytest.mark.parametrize("value", [5e-324, 1e-310, 1e-101, 1e101])
    def test_numbers_whose_squares_are_lost(self, value: float) -> None:
        system = presets.oscillator([Constraint((0,), (1.0,), 1.0, None)], 1.0)
        with pytest.raises(ModelError, match="not between"):
            solve(system, [value], [0.0], 5.0)

    def test_starts_beyond_a_wall(self) -> None:
        system = presets.oscillator([Constraint.at(0, 1.0)], 1.0)
        with pytest.raises(ModelError):
            solve(system, [1.0 + 1e-6], [0.0], 1.0)

    @pytest.mark.parametrize(("gap", "amplitude"), [(0.2, 9e99), (1e-50, 0.01)])
    def test_walls_that_rounding_hides(self, gap: float, amplitude: float) -> None:
        system = presets.chain(13, [Constraint.at(5, gap)])
        load = (Harmonic(0, amplitude, 0.7, 0.5),)
        with pytest.raises(ConvergenceError, match="knows the coordinate to"):
            solve(system, np.zeros(13), np.zeros(13), 10.0, load=load)

    def test_a_wall_on_one_side_hides_nothing(self) -> None:
        """x'' = -x + 1e99 cos 2t from rest: x is 1e99 (cos t - cos 2t)/3 until it comes back."""
        system = presets.oscillator([Constraint((0,), (1.0,), 1.0, None)], 1.0)
        t_end = 1.9
        load = (Harmonic(0, 1e99, 2.0, 0.0),)
        found = solve(system, [0.0], [0.0], t_end, load=load)
        assert found.x is not None
        exact = 1e99 * (np.cos(t_end) - np.cos(2 * t_end)) / 3
        np.testing.assert_allclose(found.x[0, 0], exact, rtol=1e-13)
