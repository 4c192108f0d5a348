"""A slice of ``nox -s truth``: random cases against references that share no formula with us."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tests.truth.sets import SETS
from tests.truth.verdicts import Case, Report

SEED = 1


def outcome(name: str, count: int, chosen: Callable[[Case], bool]) -> Report:
    """Return what the first cases of a set give, those that are chosen."""
    report, index = Report(), 0
    while count:
        case = SETS[name].case(SEED, index)
        if chosen(case):
            before = len(report.failures)
            SETS[name].check(case, report)
            new = [(kind, f"{index}: {text}") for kind, text in report.failures[before:]]
            report.failures[before:] = new
            count -= 1
        index += 1
    return report


def median(report: Report, what: str) -> float:
    values = sorted(report.ratios[what])
    return values[len(values) // 2]


@pytest.mark.needs("compiled kernels")
def test_motions_with_stops_of_finite_stiffness() -> None:
    report = outcome("elastic", 25, lambda case: case.name != "sampled")
    assert not report.failures
    assert len(report.ratios["x"]) > 15
    assert len(report.ratios["contact impulse"]) > 12
    assert median(report, "x") < 500.0


def kind(case: Case) -> str:
    return case.name.split(",")[0]


@pytest.mark.needs("compiled kernels")
def test_impact_modes_are_what_they_are_said_to_be() -> None:
    report = outcome(
        "impact-modes", 40, lambda case: kind(case) in {"dense", "diagonal", "indefinite"}
    )
    stated = [f for f in report.failures if "by the error of impulses" not in f[0]]
    assert not stated
    assert median(report, "impulse") < 100.0
    assert report.counts["existence certified"] > 25


@pytest.mark.parametrize(
    "index",
    [
        3553,  # energy: a stiff mode beside a zero of its sine, of which the phase has lost digits
        11529,  # the same with a symmetric component
        15660,  # shape: a light mass beside a heavy one, far above the spectrum
        3487,  # impulse: one that the balance of momentum makes 0
    ],
)
def test_hard_impact_modes(index: int) -> None:
    """Cases of seed 20 that were outside their errors."""
    report = Report()
    SETS["impact-modes"].check(SETS["impact-modes"].case(20, index), report)
    assert not report.failures


@pytest.mark.needs("compiled kernels")
def test_modes_exist_in_bands_and_nowhere_else() -> None:
    report = outcome("bands", 10, lambda case: kind(case) in {"dense", "diagonal", "chain"})
    stated = [f for f in report.failures if "not certified" not in f[0]]
    assert not stated
    assert report.counts["verdicts"] > 50


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("maker", ["plain", "damped", "coupled", "loaded"])
def test_motions_are_what_they_are_said_to_be(maker: str) -> None:
    report = outcome("histories", 6, lambda case: case.name == maker)
    assert not report.failures
    assert report.counts["horizon at the end"] >= 4


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize(
    ("seed", "index"),
    [
        (20, 143),  # a free body that K holds by its roundings
        (20, 3022),  # the same with drag
        (20, 730),  # 1,552 impacts of modes that damping couples, each took from the energy
        (20, 539),  # the same of one stiff mode among others
        (20, 5328),  # free bodies that slow drag couples
        (20, 715),  # a load's slope displaces a body so far that its wall seemed out of reach
        (20, 5107),  # impulses as small as the error of the state
        (109, 2059),  # all that moves rests at limiters that are nearly the same
        (109, 4932),  # three samples of a contact force that crossed zero together
        (109, 15796),  # and of the time of a rest
        (109, 17210),  # 65 rests, each of which adds the same rounding
        (109, 19371),  # the end of a contact, after a hundred others
        (110, 15409),  # impacts that open contacts whose force has not vanished
        (111, 6903),  # the reference dropped terms of what no spring holds and a load pushes
        (109, 18642),  # 2,120 impacts between close stops of what a slow load carries far
    ],
)
def test_hard_motions(seed: int, index: int) -> None:
    """Cases that were outside their errors."""
    report = Report()
    SETS["histories"].check(SETS["histories"].case(seed, index), report)
    assert not report.failures
    assert report.counts["horizon at the end"] == 1


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("seed", [0, 3, 6, 8])
def test_rattling_between_close_stops(seed: int) -> None:
    """1,200 impacts, each later or earlier by the rounding of the distance between the stops."""
    rng = np.random.default_rng(seed)
    gap = 5e-4 * float(rng.uniform(0.7, 1.3))
    stops = {"dofs": [0], "weights": [1.0], "lower": gap, "upper": 1.1 * gap, "restitution": 1.0}
    document = {
        "M": [[float(rng.uniform(0.5, 2.0))]],
        "K": [[float(rng.uniform(0.5, 2.0))]],
        "force": [float(rng.uniform(1.0, 2.0))],
        "constraints": [stops],
        "x": [0.0],
        "v": [3.0],
        "t": [0.4],
        "t_end": 0.4,
    }
    report = Report()
    SETS["histories"].check(Case("rattling", document), report)
    assert not report.failures
    assert report.counts["horizon at the end"] == 1


@pytest.mark.needs("compiled kernels")
def test_a_velocity_between_soft_limiters_whose_error_was_stated_too_small() -> None:
    report = Report()
    SETS["soft"].check(SETS["soft"].case(112, 96), report)
    assert not report.failures


@pytest.mark.needs("compiled kernels")
def test_motions_between_soft_limiters_are_what_they_are_said_to_be() -> None:
    report = outcome("soft", 6, lambda case: kind(case) in {"plain", "damped"})
    assert not report.failures


@pytest.mark.needs("compiled kernels")
def test_periodic_motions_are_what_they_are_said_to_be() -> None:
    report = outcome("periodic-motions", 14, lambda case: kind(case) != "large")
    assert not report.failures
    assert median(report, "momentum") < 100.0
    assert median(report, "phase") < 100.0
    assert median(report, "multipliers") < 100.0
    assert report.counts["verdicts certified"] > 60


@pytest.mark.needs("compiled kernels")
def test_periodic_motions_of_equal_frequencies_are_what_they_are_said_to_be() -> None:
    report = outcome("spectra", 30, lambda _: True)
    assert not report.failures
    assert report.counts["multipliers: grazing"] == 0
    assert median(report, "multipliers") < 20.0
    assert report.counts["verdicts certified"] > 80


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize(
    ("seed", "index"),
    [
        (0, 17),  # each mass joined to each: 0.41 from the multiplier
        (0, 88),  # roundings of the damping of equal modes
        (0, 109),  # a displacement that is rounding
        (0, 111),  # an unstable motion that was called stable
        (0, 218),  # roundings of modes that were turned
        (0, 285),  # damping that is rounding, of what it moves far beside its resonance
        (11, 613),  # several multipliers that may be the largest
    ],
)
def test_hard_spectra(seed: int, index: int) -> None:
    """Cases that were outside their errors."""
    report = Report()
    SETS["spectra"].check(SETS["spectra"].case(seed, index), report)
    assert not report.failures


@pytest.mark.needs("compiled kernels")
def test_bodies_that_touch_lose_energy_alone() -> None:
    """Roundings, which differ between processors, may keep one of them from coming to rest."""
    report = outcome("touching", 25, lambda case: case.name != "wedged")
    assert not report.failures
    refused = report.counts.get("refused: many more than planned", 0)
    assert refused <= 1
    assert report.counts["energies"] == 25 - refused


@pytest.mark.needs("compiled kernels")
def test_blows_at_one_instant_give_no_energy() -> None:
    report = outcome("blows", 150, lambda _: True)
    assert not report.failures
    assert report.counts["energies"] > 140
    assert report.counts["velocities"] > 80


@pytest.mark.needs("compiled kernels")
def test_motions_of_falling_bodies_are_what_they_are_said_to_be() -> None:
    report = outcome("falling", 8, lambda _: True)
    assert not report.failures
    assert report.counts["solutions"] >= 4


@pytest.mark.needs("compiled kernels")
def test_an_impulse_that_lighter_bodies_pass_on() -> None:
    """It was outside its error, as of three bodies the modes err by more of it."""
    report = Report()
    SETS["falling"].check(SETS["falling"].case(0, 21), report)
    assert not report.failures
    assert report.ratios["momentum"]


@pytest.mark.needs("compiled kernels")
def test_histories_do_what_verdicts_on_periodic_motions_say() -> None:
    report = outcome("settling", 24, lambda _: True)
    assert not report.failures
    assert report.counts["existence judged"] > 30
    assert report.counts["stability judged: stable"]
    assert report.counts["stability judged: unstable"]
