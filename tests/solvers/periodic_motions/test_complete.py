"""Whether motions with one impact in a period may be missing is said at each frequency."""

from __future__ import annotations

import numpy as np
import pytest

from tests.truth import periodic_motions as truth
from tests.truth.sets import SETS
from vibroimpact_solvers import periodic_motions as driven
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.results.periodic_motions import Result


def oscillator(
    gap: float,
    Omega: list[float],
    *load: driven.Force,
    zeta: float = 0.05,
    k: float = 0.7,
    impacts: int = 1,
) -> Result:
    """Return the motions of one mass, of natural frequency 1, with `impacts` in each period."""
    one, damping = (SymmetricMatrix.dense(np.array([[a]])) for a in (1.0, 2.0 * zeta))
    system = System(one, one, (Constraint((0,), (1.0,), None, gap, k),), C=damping)
    sequence = (driven.Impact(0, 1),) * impacts
    given = driven.Problem(system, np.array(Omega), load, sequence=sequence)
    return driven.solve(given, driven.plan(given))


def force(amplitude: float, harmonic: int = 1, phase: float = 0.0) -> driven.Force:
    return driven.Force((0,), (1.0,), amplitude, harmonic, phase)


@pytest.mark.parametrize("harmonics", [1, 2])
def test_ordinary_answers_are_complete(harmonics: int) -> None:
    loads = [force(1.0 / h, h, 0.3 * h) for h in range(1, harmonics + 1)]
    assert oscillator(0.3, [0.6, 1.1, 2.3], *loads).complete.all()


@pytest.mark.parametrize("harmonics", [1, 2])
def test_where_two_motions_meet_they_may_be_missing(harmonics: int) -> None:
    """The largest gap that is reached, found by halving, is where the two of them meet."""
    loads = [force(1.0 / h, h, 0.3 * h) for h in range(1, harmonics + 1)]

    def struck(gap: float) -> bool:
        return bool((oscillator(gap, [1.3], *loads).solution_impacts > 0).any())

    low, high = 0.01, 100.0
    assert struck(low)
    assert not struck(high)
    while np.nextafter(low, np.inf) < high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if struck(middle) else (low, middle)
    assert not oscillator(low, [1.3], *loads).complete.any()
    assert not oscillator(high, [1.3], *loads).complete.any()
    for gap in (low * (1.0 - 1e-9), high * (1.0 + 1e-9)):
        assert oscillator(gap, [1.3], *loads).complete.all()


def test_the_resonance_itself_of_what_nothing_damps() -> None:
    result = oscillator(0.3, [1.0, 1.3], force(1.0), zeta=0.0)
    assert result.complete.tolist() == [False, True]


@pytest.mark.parametrize("index", [145, 321])
def test_what_impacts_take_is_not_known_beside_the_resonance_of_what_nothing_damps(
    index: int,
) -> None:
    """Two motions are missing 1e-9 beside it, and may be: the reference has them."""
    document = SETS["spectra"].case(31, index).document
    given = truth.problem(document)
    result = driven.solve(given, driven.plan(given))
    assert result.complete.tolist() == [True, False]
    phases = np.linspace(0.0, 2.0 * np.pi, 4001)
    for k, Omega in enumerate(document["Omega"]):
        distance = truth.motion(document, Omega).distances(phases)
        assert (np.diff(np.signbit(distance)) != 0).sum() == 2
        found = (result.solution_frequency_index == k) & (result.solution_impacts > 0)
        assert found.sum() == (2 if result.complete[k] else 0)


def test_sequences_that_are_searched_for_are_never_said_to_be_complete() -> None:
    assert not oscillator(0.3, [1.3], force(1.0), impacts=2).complete.any()
