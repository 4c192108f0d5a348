"""Attractors of one mass with one stop, against motions from impact to impact.

Shaw and Holmes (J. Sound Vib. 90, 1983, 129-155) describe the motions with one impact in n periods
of the drive, their flips and the chaos that follows. With the stop at rest position free bounces
take half a natural period, so that those with one impact in n periods are near the frequencies 2 n.
The numbers here are those of the reference, not of the paper.
"""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pytest
from scipy.stats import binomtest

from tests.solvers.attractors.bouncing import Bouncing
from vibroimpact_solvers import attractors, periodic_motions, time_history
from vibroimpact_solvers.attractors import Force, Nature, Verification
from vibroimpact_solvers.errors import Cancelled, ModelError, PlanError, Status
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

ONE = SymmetricMatrix.diagonal([1.0])
LOAD = (Force((0,), (1.0,), 1.0),)


def system(a: float = 0.05, k: float = 0.8, gap: float = 0.0) -> System:
    wall = Constraint((0,), (1.0,), lower=None, upper=gap, restitution=k)
    return System(ONE, ONE, (wall,), C=SymmetricMatrix.diagonal([2.0 * a]) if a else None)


def states(count: int, gap: float = 0.0) -> tuple[Any, Any]:
    rng = np.random.default_rng(1)
    return min(gap, 1.0) - 2.0 * rng.random((count, 1)), 2.0 * rng.standard_normal((count, 1))


def solved(omega: float, count: int = 12, gap: float = 0.0, **options: Any) -> attractors.Result:
    x, v = states(count, gap)
    load = options.pop("load", LOAD)
    of = options.pop("system", system(gap=gap))
    problem = attractors.Problem(of, np.array([omega]), x, v, load, **options)
    return attractors.solve(problem, attractors.plan(problem))


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize(
    ("omega", "period", "impacts"),
    [(2.0, 1, 1), (4.0, 2, 1), (6.0, 3, 1), (2.7, 2, 2), (2.9, 4, 9), (3.0, 4, 4)],
)
def test_periods_are_those_of_motions_from_impact_to_impact(
    omega: float, period: int, impacts: int
) -> None:
    result = solved(omega)
    row = int(np.flatnonzero(result.attractor_period == period)[0])
    assert result.attractor_nature[row] == Nature.PERIODIC
    assert result.attractor_impacts[row] == impacts
    one = Bouncing(omega)
    x, v = float(result.attractor_x[row, 0]), float(result.attractor_v[row, 0])
    # The state returns after the period, not before, with as many impacts.
    nx, nv, count = one.after(x, v, period)
    assert math.hypot(nx - x, nv - v) < 1e-5
    assert count == impacts
    for less in range(1, period):
        nx, nv, _ = one.after(x, v, less)
        assert math.hypot(nx - x, nv - v) > 1e-3
    # And motions from the given states come there.
    sx, sv = states(12)
    mine = int(np.flatnonzero(result.settled_attractor == row)[0])
    far = one.after(float(sx[mine, 0]), float(sv[mine, 0]), 200 + 400)
    points = [one.after(x, v, shift) for shift in range(period)]
    assert min(math.hypot(far[0] - p[0], far[1] - p[1]) for p in points) < 1e-5


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("omega", [1.5, 2.0, 2.5, 2.6, 2.65, 2.7, 3.0, 3.5, 4.0])
def test_exponents_are_those_of_the_multipliers(omega: float) -> None:
    result = solved(omega)
    assert result.attractor_stability is not None
    assert result.error_stability is not None
    assert (result.attractor_verification == Verification.CONFIRMED).all()
    duration = result.attractor_period * 2.0 * math.pi / omega
    expected = np.log(result.attractor_stability) / duration
    doubt = result.error_stability / result.attractor_stability / duration
    apart = np.abs(result.attractor_exponent - expected)
    assert (apart <= result.error_attractor_exponent + doubt).all()
    assert (result.error_attractor_exponent < 0.05).all()


@pytest.mark.needs("compiled kernels")
def test_chaos_has_the_exponent_of_neighbouring_motions() -> None:
    result = solved(2.8, count=8, observe=1000)
    assert result.attractor_nature.tolist() == [Nature.CHAOTIC]
    assert result.attractor_period.tolist() == [0]
    value, error = result.attractor_exponent[0], result.error_attractor_exponent[0]
    assert value > 3.0 * error
    expected = Bouncing(2.8).exponent(-1.0, 0.5, 2000)
    # The neighbouring motions have an error of their own, of about one in 30.
    assert abs(value - expected) < error + 0.05 * expected
    assert (np.abs(result.settled_exponent - value) < result.error_settled_exponent + error).all()


@pytest.mark.needs("compiled kernels")
def test_coexisting_attractors_are_both_counted() -> None:
    """At 2.6, one impact in one period and three impacts in three: whichever is nearer."""
    result = solved(2.6, count=30)
    assert sorted(result.attractor_period.tolist()) == [1, 3]
    assert result.attractor_motions.sum() == 30
    assert result.attractor_fraction.sum() == pytest.approx(1.0)
    one, (x, v) = Bouncing(2.6), states(30)
    for row in range(10):
        here = one.after(float(x[row, 0]), float(v[row, 0]), 300)[:2]
        later = one.after(*here, 1)[:2]
        period = 1 if math.dist(here, later) < 1e-4 else 3
        assert result.settled_period[row] == period
        assert result.attractor_period[result.settled_attractor[row]] == period


def test_fractions_have_the_interval_of_wilson() -> None:
    result = solved(2.6, count=30)
    for row, count in enumerate(result.attractor_motions.tolist()):
        known = binomtest(count, 30).proportion_ci(0.95, method="wilson")
        assert result.attractor_fraction_low[row] == pytest.approx(known.low, rel=1e-9)
        assert result.attractor_fraction_high[row] == pytest.approx(known.high, rel=1e-9)
        fraction = result.attractor_fraction[row]
        assert result.error_fraction[row] == pytest.approx(
            max(known.high - fraction, fraction - known.low)
        )


def test_motions_without_impacts_contract_by_the_damping() -> None:
    result = solved(2.0, gap=1.0)
    assert result.attractor_impacts.tolist() == [0]
    assert result.attractor_impact_rate.tolist() == [0.0]
    assert result.attractor_exponent[0] == pytest.approx(-0.05, rel=1e-12)
    assert result.attractor_stability is not None
    assert result.attractor_stability[0] == pytest.approx(math.exp(-0.05 * math.pi), rel=1e-12)
    # The state at phase 0 is the real part of the response.
    response = 1.0 / complex(1.0 - 4.0, 0.2)
    assert result.attractor_x[0, 0] == pytest.approx(response.real, abs=result.error_x[0, 0])
    assert result.attractor_v[0, 0] == pytest.approx(
        (2j * response).real, abs=result.error_v[0, 0] + 1e-15
    )


@pytest.mark.parametrize("omega", [1.5, 2.0, 2.5, 2.65])
def test_states_are_those_of_the_periodic_motion_within_their_errors(omega: float) -> None:
    result = solved(omega)
    row = int(np.flatnonzero(result.attractor_period == 1)[0])
    request = periodic_motions.Problem(
        system(), np.array([omega]), LOAD, outputs=frozenset({"exists", "waveform"}),
        tau=np.array([0.0]),
    )  # fmt: skip
    exact = periodic_motions.solve(request, periodic_motions.plan(request))
    assert exact.waveform is not None
    assert exact.error_waveform is not None
    apart = np.abs(exact.waveform[:, 0, 0] - result.attractor_x[row, 0])
    nearest = int(apart.argmin())
    assert apart[nearest] <= result.error_x[row, 0] + exact.error_waveform[nearest, 0, 0]
    assert result.error_x[row, 0] < 1e-9


@pytest.mark.parametrize("omega", [2.7, 2.9])
def test_impacts_are_at_their_times_after_the_state_of_the_attractor(omega: float) -> None:
    """A time history from that state has them there, the first period of the drive first."""
    result = solved(omega, count=6)
    for row in np.flatnonzero(result.attractor_impacts > 0):
        mine = result.impact_attractor == row
        period = 2.0 * np.pi / omega * result.attractor_period[row]
        state = time_history.State(result.attractor_x[row], result.attractor_v[row])
        problem = time_history.Problem(
            system(), state, period, outputs=frozenset({"impacts"}),
            load=(time_history.Harmonic(0, 1.0, omega, 0.0),),
        )  # fmt: skip
        history = time_history.solve(problem, time_history.plan(problem))
        times = np.sort(result.impact_time[mine])
        assert times == pytest.approx(history.impact_time, abs=1e-5)
        assert np.mod(omega * result.impact_time[mine], 2.0 * np.pi) == pytest.approx(
            result.impact_phase[mine]
        )
        assert (result.error_time[mine] < 1e-9).all()


def test_long_observations_of_large_structures_are_refused() -> None:
    with pytest.raises(PlanError, match="settle and observe for less time"):
        solved(2.0, observe=10_000_000)


@pytest.mark.parametrize("more", ["settle", "observe"])
def test_the_longer_part_of_what_takes_too_long_is_blamed(more: str) -> None:
    with pytest.raises(PlanError) as refused:
        solved(2.0, **{"settle": 50_000_000, "observe": 10_000_000, more: 100_000_000})
    assert refused.value.pointer == (more,)


def test_without_amplitude_everything_comes_to_rest() -> None:
    result = solved(1.0, gap=1.0, load=(Force((0,), (1.0,), 0.0),), settle=400)
    assert result.attractor_period.tolist() == [1]
    assert result.attractor_impacts.tolist() == [0]
    assert abs(result.attractor_x[0, 0]) <= 1e-9


def test_motions_that_rest_at_the_wall_are_periodic_without_exponent() -> None:
    result = solved(0.5, count=3, gap=-0.5, system=system(k=0.3, gap=-0.5))
    assert result.attractor_nature.tolist() == [Nature.PERIODIC]
    assert result.attractor_rests.all()
    assert np.isnan(result.attractor_exponent).all()
    assert result.attractor_verification is not None
    assert result.attractor_verification[0] == Verification.RESTS


def test_a_start_outside_of_the_limits_has_a_status() -> None:
    x, v = states(4)
    x[2, 0] = 1.0
    problem = attractors.Problem(system(), np.array([2.0]), x, v, LOAD)
    result = attractors.solve(problem, attractors.plan(problem))
    assert result.settled_status.tolist() == [Status.OK, Status.OK, Status.INVALID, Status.OK]
    assert result.settled_attractor.tolist() == [0, 0, -1, 0]
    assert result.attractor_motions.tolist() == [3]
    assert result.attractor_fraction.tolist() == [1.0]
    assert len(result.error_failures) == 1
    nowhere = attractors.Problem(system(), np.array([2.0]), x[2:3], v[2:3], LOAD)
    none = attractors.solve(nowhere, attractors.plan(nowhere))
    assert none.attractor_nature.size == none.impact_phase.size == 0


def test_sections_at_impacts_are_the_impacts() -> None:
    result = solved(2.9, section="impacts", points=5)
    assert result.section_phase is not None
    assert result.section_velocity is not None
    assert result.section_x is None
    assert result.section_phase.size == 5
    np.testing.assert_allclose(result.section_velocity[:5], result.impact_velocity[:5], rtol=1e-5)
    np.testing.assert_allclose(result.section_phase[:5], result.impact_phase[:5], rtol=1e-5)
    many = solved(2.8, count=2, points=50)
    assert many.section_x is not None
    assert many.section_x.shape == (50, 1)
    assert (many.section_x <= 0.0).all()


def test_what_is_not_requested_is_absent() -> None:
    result = solved(2.0, outputs=frozenset({"section"}))
    assert result.attractor_verification is result.attractor_stability is None
    skipped = attractors.plan(
        attractors.Problem(
            system(), np.array([2.0]), *states(2), LOAD, outputs=frozenset({"section"})
        )
    ).skips
    assert "stability" in [skip.what for skip in skipped]


def test_batches_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = solved(2.6, count=30)
    monkeypatch.setattr("vibroimpact_solvers.attractors.planning._MEMORY", 2**20)
    parts = solved(2.6, count=30)
    for name, value in vars(whole).items():
        if isinstance(value, np.ndarray):
            np.testing.assert_array_equal(value, getattr(parts, name), err_msg=name)


@pytest.mark.parametrize(
    ("options", "pointer", "code"),
    [
        ({"system": system(a=0.0, k=1.0)}, ("system", "C"), "undamped"),
        ({"system": system().limited(())}, ("system", "constraints"), "no_constraint"),
        ({"load": ()}, ("load",), "no_load"),
        ({"load": (Force((3,), (1.0,), 1.0),)}, ("load", 0, "dof"), "index_out_of_range"),
        ({"observe": 20}, ("observe",), "out_of_range"),
        ({"settle": -1}, ("settle",), "out_of_range"),
        ({"section": "nowhere"}, ("section",), "unknown_choice"),
        ({"tolerance": 0.5}, ("tolerance",), "out_of_range"),
        ({"dofs": np.array([1])}, ("dofs", 0), "index_out_of_range"),
        ({"outputs": frozenset({"x"})}, ("outputs",), "unknown_output"),
    ],
)
def test_errors_name_the_field(
    options: dict[str, Any], pointer: tuple[str | int, ...], code: str
) -> None:
    with pytest.raises(ModelError) as caught:
        solved(2.0, **options)
    assert (caught.value.pointer, caught.value.code) == (pointer, code)


def test_several_frequencies_are_for_sweeps() -> None:
    with pytest.raises(ModelError) as caught:
        attractors.Problem(system(), np.array([2.0, 3.0]), *states(2), LOAD)
    assert caught.value.pointer == ("frequency",)


def test_motions_that_nothing_draws_together_are_undecided() -> None:
    """Without damping, those that never reach the stop keep what they started with."""
    result = solved(2.0, gap=9.0, system=system(a=0.0, gap=9.0), load=(Force((0,), (1.0,), 0.1),))
    assert result.attractor_nature.tolist() == [Nature.UNDECIDED]
    assert result.attractor_impact_rate.tolist() == [0.0]
    assert len(result.error_undecided) == 10
    assert result.error_undecided[0].startswith("motion 0: no impact and no damping")


def test_transients_that_are_too_long_say_for_how_long_to_wait() -> None:
    """Without drive, x fades as exp(-a t), by exp(-2 pi a) in each period; then it rests at 0."""
    slow = system(a=2e-3, gap=9.0)
    still = (Force((0,), (1.0,), 0.0),)
    options = {"system": slow, "gap": 9.0, "load": still, "count": 1}
    early = solved(1.0, settle=10, observe=40, **options)
    assert early.attractor_nature.tolist() == [Nature.UNDECIDED]
    (hint,) = early.error_undecided
    told = re.search(r"by a factor of ([\d.]+) in each period .* about (\d+) periods more", hint)
    assert told is not None
    assert float(told[1]) == pytest.approx(math.exp(-2.0 * math.pi * 2e-3), rel=1e-3)
    late = solved(1.0, settle=10 + int(told[2]), observe=40, **options)
    assert late.attractor_nature.tolist() == [Nature.PERIODIC]
    assert late.error_undecided == []


@pytest.mark.parametrize(("omega", "period", "impacts"), [(2.7, 2, 2), (2.9, 4, 9), (6.0, 3, 1)])
def test_rates_of_impacts_are_those_of_a_period(omega: float, period: int, impacts: int) -> None:
    """Whenever it is observed: 0.2.0 counted what fell into the observation, of 41 periods here."""
    for settle, observe in ((300, 41), (301, 50)):
        result = solved(omega, settle=settle, observe=observe)
        row = int(np.flatnonzero(result.attractor_period == period)[0])
        assert result.attractor_impact_rate[row] == impacts / period
        assert result.error_impact_rate[row] == 0.0


@pytest.mark.parametrize("size", [1e-9, 1e9])
def test_units_change_nothing(size: float) -> None:
    """With the stop at rest position the motion is proportional to the load."""
    x, v = (size * values for values in states(6))
    load = (Force((0,), (1.0,), size),)
    problem = attractors.Problem(system(), np.array([2.6]), x, v, load)
    result = attractors.solve(problem, attractors.plan(problem))
    expected = solved(2.6, count=6)
    assert result.settled_attractor.tolist() == expected.settled_attractor.tolist()
    assert result.attractor_period.tolist() == expected.attractor_period.tolist()
    np.testing.assert_allclose(result.impact_momentum, size * expected.impact_momentum, rtol=1e-9)


def test_a_computation_is_stopped_by_its_tick() -> None:
    seen = list[tuple[int, int]]()

    def tick(done: int, total: int) -> None:
        seen.append((done, total))
        if len(seen) > 2:
            raise Cancelled

    problem = attractors.Problem(system(), np.array([2.8]), *states(40), LOAD)
    with pytest.raises(Cancelled):
        attractors.solve(problem, attractors.plan(problem), tick)
    assert seen[0] == (0, 40)


def test_losses_at_the_stop_are_enough() -> None:
    """Without damping, the motions with impacts settle."""
    result = solved(2.0, system=system(a=0.0, k=0.8))
    assert (result.attractor_nature == Nature.PERIODIC).all()
