"""Prices are measured: their constants are found again, and methods of all kinds have some."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from benchmarks.prices import calibration, table
from benchmarks.prices.calibration import Samples
from benchmarks.prices.measured import Measured, planned
from benchmarks.prices.requests import DRAWN, Case, case
from benchmarks.prices.structures import structure
from vibroimpact_schema import examples
from vibroimpact_service.kinds import KINDS
from vibroimpact_solvers import rates
from vibroimpact_solvers.plan import OVERHEAD_SECONDS, Plan, Stage, Step
from vibroimpact_solvers.rates import Rate, Sweep


@pytest.fixture
def own_rates() -> Iterator[None]:
    """Let a test use other rates."""
    before = rates.RATES, rates.SWEEP
    yield
    calibration.use(*before)  # type: ignore[arg-type]


def test_constants_are_found_from_sums_of_times() -> None:
    random = np.random.default_rng(0)
    flops = np.exp(random.uniform(5.0, 22.0, (60, 2)))
    features = np.column_stack([np.ones(60), flops])
    constants = np.array([2e-3, 5e-10, 3e-11])
    seconds = features @ constants * np.exp(random.uniform(-0.1, 0.1, 60))
    seconds[:3] *= 1000.0  # exceptions
    ended = np.zeros(60, dtype=bool)
    ended[3:6] = True
    seconds[3:6] *= 0.01  # they were ended long before their time
    samples = Samples(features, np.zeros(60), seconds, ended)
    found = calibration.fitted(samples, np.array([1e-4, 1e-9, 1e-9]))
    np.testing.assert_allclose(found, constants, rtol=0.2)


def test_methods_that_the_examples_of_all_kinds_use_are_measured() -> None:
    """Those that a few requests of the calibration would not tell are listed here."""
    unmeasured = set()
    for kind in KINDS.values():
        for example in examples.requests(kind.name).values():
            plan = planned(Case(kind.name, "", example["request"])).plan
            of = plan.of or plan.kind
            assert rates.RATES[of].start > 0.0
            names = {step.rate_name(of) for step in plan.steps if step.flops}
            unmeasured |= names - rates.RATES.keys()
    assert unmeasured <= UNMEASURED


def test_methods_of_motions_with_stops_that_yield_are_measured() -> None:
    """No example has them; a method that is renamed would lose its rate in silence."""
    spring = {"type": "linear", "stiffness": 10.0}
    system = {
        "preset": "oscillator", "Omega0": 1.0, "zeta": 0.1,
        "constraints": [{"dof": 0, "gap": {"lower": None, "upper": 0.1}, "law": spring}],
    }  # fmt: skip
    request = {
        "system": system, "load": [{"dof": 0, "amplitude": 1.0}], "frequency": [0.8],
    }  # fmt: skip
    hertz = {"type": "hertz", "stiffness": 10.0}
    struck = system | {"constraints": [{"dof": 0, "gap": 0.1, "law": hertz}]}
    start = {"system": struck, "initial": {"x": [0.0], "v": [1.0]}, "t_end": 9.0}
    plan = planned(Case("time-history", "", start)).plan
    names = {step.rate_name("time-history") for step in plan.steps if step.flops}
    assert any("switchings" in name for name in names)
    assert names <= rates.RATES.keys()
    plan = planned(Case("periodic-motions", "", request)).plan
    names = {step.rate_name("periodic-motions") for step in plan.steps if step.flops}
    assert "periodic-motions: impulse, isolation of durations" in names
    assert names <= rates.RATES.keys()


UNMEASURED = {
    "spectrum, static condensation",
    "time-history: free_motion, exact between impacts, in extended precision where needed",
    "time-history: free_motion, integrator of scipy",
    "impact-modes: impulse, bordered",
    "periodic-motions: waveform, superposition",
    "slow-flow: slow_flow, quadrature",
    # Of calibrations, whose work is nearly all that of their bases.
    "natural-frequencies: fit, trust region, derivatives",
    "natural-frequencies: profile, profile likelihood",
    "natural-frequencies: derivatives, rates of the modes",
    # Of the impact modes from which histories begin.
    "time-history: existence, certified",
    "time-history: impulse, scalar",
}


def seconds(kind: str, document: dict[str, Any]) -> float:
    return planned(Case(kind, "", document)).seconds


def test_a_short_motion_of_a_beam_is_computed_at_once() -> None:
    """0.1 s of a beam, whose fastest mode turns 10,000 times as often as the first one."""
    beam = structure("beam", 100, 0)
    v = [0.0] * beam.n
    v[beam.dof] = 50.0
    motion = {"system": beam.damped, "initial": {"x": [0.0] * beam.n, "v": v}, "t_end": 0.1}
    assert seconds("time-history", motion) < 1.0
    longer = seconds("time-history", {**motion, "t_end": 1000.0})
    assert longer > 100.0 * seconds("time-history", {**motion, "t_end": 1.0})


def test_a_branch_takes_about_a_second() -> None:
    """The least take a sixth of one, most of those of beams and plates one to three."""
    _, document = DRAWN["branches"][1](np.random.default_rng(0))
    assert 0.3 < seconds("branches", document) < 3.0


def test_an_attractor_is_searched_for_where_the_load_reaches_a_wall() -> None:
    one = structure("oscillator", 1, 0)
    request = {
        "system": one.damped,
        "frequency": {"values": [1.0]},
        "initial": {"x": [[0.0]], "v": [[0.0]]},
    }

    def price(size: float) -> float:
        load = [{"dof": 0, "amplitude": one.force(size)}]
        return seconds("attractors", {**request, "load": load})

    assert price(2.0) > 3.0 * price(0.5)


@pytest.mark.usefixtures("own_rates")
def test_sweeps_cost_what_their_points_do() -> None:
    calibration.use(
        {"kind": Rate(0.5, 0.0), "kind: shape, sum": Rate(1.0, 1e-3)}, Sweep(7, 3, 2, 1)
    )
    steps = (Step(Stage.SHAPE, "sum", "", flops=1e3),)
    own = OVERHEAD_SECONDS
    assert Plan("kind", steps).seconds == pytest.approx(own + 0.5 + 1.0 + 1.0)
    swept = Plan("sweep", steps, points=10, of="kind")
    assert swept.seconds == pytest.approx(own + 7.0 + 10.0 * (3.0 + 2.0 * 1.5) + 1.0)
    known = (Step(Stage.SHAPE, "sum", ""),)  # what is known takes nothing
    assert Plan("kind", known).seconds == pytest.approx(own + 0.5)


@pytest.mark.usefixtures("own_rates")
def test_rates_fit_the_requests_that_they_were_made_of() -> None:
    """Times by known constants, of requests as they are drawn, are told again by new ones."""
    rows = []
    for seed in range(12):
        drawn = case("periodic-motions", seed)
        found = planned(drawn)
        rows.append(Measured("periodic-motions", seed, drawn.about, 0.0, found.seconds, 0.0, [], 1))
    spectra = {name: rate for name, rate in rates.RATES.items() if name.startswith("spectrum")}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(calibration, "_of_spectra", lambda: dict(spectra))
        calibration.use(*calibration.calibrate(rows, 8.0))
    again = calibration.estimates(rows)
    ratios = [one.estimate / one.measured for one in again]
    assert 0.3 < min(ratios) <= max(ratios) < 3.0
    assert "| periodic-motions | 12 |" in table.text(again, 8.0)
    assert math.isfinite(sum(ratios))


def test_kinds_that_were_not_measured_keep_their_rates() -> None:
    measured = {"slow-flow": Rate(7.0, 0.0), "slow-flow: new, method": Rate(8.0, 1.0)}
    both = calibration.with_others(measured)
    other = {name: rate for name, rate in rates.RATES.items() if not name.startswith("slow-flow")}
    assert both == other | measured
    assert list(both)[: len(other)] == list(rates.RATES)[: len(other)]
