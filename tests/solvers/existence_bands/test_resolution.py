"""Bands at a resolution, against all bands and against impact modes at other frequencies."""

from __future__ import annotations

import numpy as np
import pytest

import vibroimpact as vi
from tests.solvers.beams import OMEGA, cantilever
from vibroimpact_solvers import existence_bands as bands
from vibroimpact_solvers import impact_modes as modes
from vibroimpact_solvers import spectrum
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.model import Constraint, System
from vibroimpact_solvers.presets import chain


def solved(system: System, start: float, stop: float, resolution: float | None) -> bands.Result:
    problem = bands.Problem(system, start, stop, resolution=resolution)
    return bands.solve(problem, bands.plan(problem))


def exists(system: System, Omega: np.ndarray) -> np.ndarray:
    outputs = frozenset({"exists"})
    problem = modes.Problem(system, Omega * (2 / np.pi), (0,), outputs, Omega=Omega)
    return modes.solve(problem, modes.plan(problem)).exists


@pytest.fixture(scope="module")
def every() -> bands.Result:
    """All bands of a beam of 24 degrees of freedom."""
    return solved(cantilever(12, damped=False), OMEGA, 1.2 * OMEGA, None)


@pytest.mark.parametrize("resolution", [1e-2, 1e-3, 2e-4])
def test_all_that_is_as_wide_is_found(every: bands.Result, resolution: float) -> None:
    some = solved(cantilever(12, damped=False), OMEGA, 1.2 * OMEGA, resolution)
    wide = resolution * 0.2 * OMEGA
    for start, stop in (("band_start", "band_stop"), ("rejected_start", "rejected_stop")):
        all_of = np.stack([getattr(every, start), getattr(every, stop)])
        found = np.stack([getattr(some, start), getattr(some, stop)])
        missing = set(map(tuple, all_of.T[all_of[1] - all_of[0] > wide])) - set(map(tuple, found.T))
        assert not missing
        # Nothing is found that is not there: the same edges, to the last bit.
        assert set(map(tuple, found.T)) <= set(map(tuple, all_of.T))
    assert some.band_start.size < every.band_start.size or resolution < 1e-3


def test_the_fraction_that_is_not_examined(every: bands.Result) -> None:
    """It falls with the resolution, and is that of the poles between which no frequency lies."""
    system = cantilever(12, damped=False)
    natural = spectrum.spectrum(system)
    poles = np.concatenate(
        [root / np.arange(1.0, root / OMEGA + 2.0, 2.0) for root in natural.roots]
    )
    poles = np.unique(np.concatenate([poles[(poles > OMEGA) & (poles < 1.2 * OMEGA)]]))
    marks = np.concatenate([[OMEGA], poles, [1.2 * OMEGA]])
    fractions = []
    for resolution in (1e-2, 1e-3, 1e-4):
        some = solved(system, OMEGA, 1.2 * OMEGA, resolution)
        grid = np.linspace(OMEGA, 1.2 * OMEGA, round(1 / resolution) + 1)
        counts = np.histogram(grid, marks)[0]
        expected = np.diff(marks)[counts == 0].sum() / (0.2 * OMEGA)
        assert some.error_unresolved == pytest.approx(expected, abs=1e-9)
        assert some.error_complete is False
        fractions.append(some.error_unresolved)
    assert fractions == sorted(fractions, reverse=True)
    assert every.error_complete is True
    assert every.error_unresolved == 0.0


def test_bands_are_complete_where_the_grid_meets_every_interval() -> None:
    system = chain(13, [Constraint.at(5, 1.0)])
    some, whole = solved(system, 0.3, 0.8, 1e-3), solved(system, 0.3, 0.8, None)
    assert some.error_complete is True
    assert (some.error_unresolved, some.error_resolution) == (0.0, whole.error_resolution)
    np.testing.assert_array_equal(some.band_start, whole.band_start)
    np.testing.assert_array_equal(some.band_stop, whole.band_stop)
    assert solved(system, 0.3, 0.8, 1e-2).error_complete is False


@pytest.mark.parametrize("elements", [25, 150, 300])
def test_large_beams_at_a_resolution(elements: int) -> None:
    system = cantilever(elements, damped=False)
    some = solved(system, OMEGA, 1.3 * OMEGA, 2e-2)
    assert some.band_start.size > 0
    assert some.error_resolution == pytest.approx(2e-2 * 0.3 / 1.3)
    inside = 0.37 * some.band_start + 0.63 * some.band_stop
    assert exists(system, inside).all()
    failing = 0.41 * some.rejected_start + 0.59 * some.rejected_stop
    assert not exists(system, failing).any()
    assert 0.9 < some.error_unresolved < 1.0


def test_searched_families_are_looked_at_on_the_grid() -> None:
    system = chain(13, [Constraint((5,), (1.0,), 1.0, 1.2)])
    some = solved(system, 0.5, 2.5, 1e-3)
    assert some.error_complete is False
    assert some.error_resolution == pytest.approx(1e-3 * 2.0 / 0.5, rel=0.01)
    whole = solved(system, 0.5, 2.5, None)
    wide = whole.band_stop - whole.band_start > 2e-3 * 2.0
    middle = (0.5 * (whole.band_start + whole.band_stop))[wide]
    assert middle.size >= 5
    # Bands with a narrow gap between them are one.
    inside = (some.band_start < middle[:, np.newaxis]) & (middle[:, np.newaxis] < some.band_stop)
    assert inside.any(axis=1).all()


def test_no_range_is_refused_for_its_poles_at_a_resolution() -> None:
    system = chain(13, [Constraint.at(5, 1.0)])
    with pytest.raises(ModelError, match="ask for a `resolution`"):
        bands.plan(bands.Problem(system, 1e-8, 1.0))
    some = solved(system, 1e-8, 1.0, 1e-2)
    assert some.error_complete is False
    assert some.band_start.size > 0


@pytest.mark.parametrize("resolution", [0.0, -1e-3, 1e-9, 0.5, float("nan")])
def test_a_wrong_resolution_is_named(resolution: float) -> None:
    with pytest.raises(ModelError) as caught:
        bands.Problem(chain(3, [Constraint.at(0, 1.0)]), 0.5, 1.0, resolution=resolution)
    assert caught.value.pointer == ("resolution",)


def test_the_client_asks_for_a_resolution() -> None:
    system = vi.chain(13, [vi.constraint(5, 1.0)])
    with vi.Local() as local:
        some = local.existence_bands(system, 0.3, 0.8, resolution=1e-2)
        every = local.existence_bands(system, 0.3, 0.8)
        assert not some.error.complete
        assert 0.0 < some.error.unresolved < 0.1
        assert every.error.complete
        with pytest.raises(vi.InvalidRequest, match="resolution"):
            local.existence_bands(system, 0.3, 0.8, resolution=2.0)


def test_poles_that_no_memory_holds_are_refused_however_modes_are_found() -> None:
    """Of 600 degrees of freedom few modes would have been computed, and 5e7 poles listed."""
    problem = bands.Problem(cantilever(300, damped=False), OMEGA, 1.3 * OMEGA)
    with pytest.raises(ModelError, match="ask for a `resolution`") as caught:
        bands.plan(problem)
    assert caught.value.pointer == ("frequency", "start")
