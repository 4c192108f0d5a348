"""Response spectra beside an integration of structure and oscillators together."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
import scipy.integrate

import vibroimpact as vi
from vibroimpact.oscillators import Jumps, Pieces, largest
from vibroimpact.response_spectra import ResponseSpectrum

mpl.use("Agg")
needs_kernels = pytest.mark.needs("compiled kernels")

Array = np.ndarray[Any, np.dtype[np.float64]]


@dataclass(frozen=True)
class Together:
    """A structure with oscillators on one of its coordinates, integrated from event to event.

    Displacements are absolute, those of the base are states: its acceleration alone is given.
    Each stop is (dof, side, gap, restitution) or, elastic, (dof, side, gap, stiffness, dashpot).
    """

    M: Array
    K: Array
    C: Array
    stops: list[tuple[float, ...]]
    dof: int
    rates: Array
    damping: float
    force: Callable[[float], Array] = lambda t: np.zeros(1)
    influence: Array | None = None
    base: Callable[[float], float] = lambda t: 0.0

    @cached_property
    def inverse(self) -> Array:
        return np.asarray(np.linalg.inv(self.M))

    def depth(self, stop: tuple[float, ...], y: Array) -> tuple[float, float]:
        """Return how far a coordinate is beyond a wall that moves with the base, and its rate."""
        n, (dof, side, gap) = len(self.K), (int(stop[0]), stop[1], stop[2])
        r = self._influence[dof]
        x, v = y[dof] - r * y[-2], y[n + dof] - r * y[-1]
        return float(side * x - gap), float(side * v)

    @property
    def _influence(self) -> Array:
        return np.zeros(len(self.K)) if self.influence is None else self.influence

    def rate(self, t: float, y: Array) -> Array:
        n, m, r = len(self.K), self.rates.size, self._influence
        x, v, w, u = y[:n], y[n : 2 * n], y[2 * n : 2 * n + m], y[2 * n + m : 2 * n + 2 * m]
        force = self.force(t) - self.K @ (x - r * y[-2]) - self.C @ (v - r * y[-1])
        for stop in self.stops:
            if len(stop) == 5:
                d, change = self.depth(stop, y)
                if d > 0.0:
                    push = max(0.0, stop[3] * d + stop[4] * change)
                    force = force - stop[1] * push * np.eye(n)[int(stop[0])]
        a = self.acceleration(x[self.dof], v[self.dof], w, u)
        return np.concatenate([v, self.inverse @ force, u, a, [y[-1], self.base(t)]])

    def acceleration(self, x: Any, v: Any, w: Any, u: Any) -> Any:
        """Return the absolute accelerations of the oscillators."""
        rates = self.rates if np.ndim(x) == 0 else self.rates[:, np.newaxis]
        return -2.0 * self.damping * rates * (u - v) - rates**2 * (w - x)

    def events(self) -> list[Callable[[float, Array], float]]:
        """Return what is zero at impacts; forces of elastic stops are left to the step control."""
        events: list[Any] = []
        for stop in self.stops:
            if len(stop) == 4:
                events.append(lambda t, y, stop=stop: self.depth(stop, y)[0])
                events[-1].terminal, events[-1].direction = True, 1.0
        return events

    def strike(self, y: Array) -> Array:
        n, y = len(self.K), y.copy()
        for stop in self.stops:
            d, change = self.depth(stop, y)
            if len(stop) == 4 and abs(d) < 1e-9 and change > 0.0:
                by_one = self.inverse[int(stop[0])]
                jump = (1.0 + stop[3]) * change / by_one[int(stop[0])]
                y[n : 2 * n] -= stop[1] * jump * by_one
        return y

    def spectrum(self, x: Array, v: Array, end: float) -> tuple[Array, Array, int]:
        """Return largest deflections and accelerations, from relative states, and the events."""
        n, m = len(self.K), self.rates.size
        y = np.concatenate([x, v, np.full(m, x[self.dof]), np.full(m, v[self.dof]), [0.0, 0.0]])
        t, z, a, count = 0.0, np.zeros(m), np.zeros(m), 0
        while t < end:
            run = scipy.integrate.solve_ivp(
                self.rate, (t, end), y, method="DOP853", rtol=1e-11, atol=1e-13,
                events=self.events(), dense_output=True, first_step=1e-6,
                max_step=2e-3,
            )  # fmt: skip
            stop = run.t[-1]
            steps = max(10, int((stop - t) * self.rates.max() / 0.01))
            assert run.sol is not None
            s = np.asarray(run.sol(np.linspace(t, stop, steps)))
            w, u = s[2 * n : 2 * n + m], s[2 * n + m : 2 * n + 2 * m]
            z = np.maximum(z, np.abs(w - s[self.dof]).max(axis=1))
            here = self.acceleration(s[self.dof], s[n + self.dof], w, u)
            a = np.maximum(a, np.abs(here).max(axis=1))
            t, y, count = stop, self.strike(run.y[:, -1]), count + (stop < end)
        return z, a, count


M = np.array([[2.0, 0.4], [0.4, 1.0]])
K = np.array([[300.0, -120.0], [-120.0, 150.0]])
C = 0.02 * M + 0.001 * K
RATES = np.array([2.0, 8.0, 13.0, 30.0, 80.0])
SI = {"length": "m", "mass": "kg", "time": "s"}
STRUCK = vi.system(
    [1.0], [[25.0]], [vi.constraint(0, {"lower": None, "upper": 0.1}, restitution=0.7)],
    C=[[0.2]], units=SI,
)  # fmt: skip


def _struck(num: int, *outputs: str) -> vi.TimeHistory:
    start, load = ([0.0], [0.8]), [vi.harmonic(0, 2.0, 4.0)]
    return vi.Local().time_history(
        STRUCK, start, 2.0, t=num, load=load, outputs=["x", "v", *outputs]
    )


def _agrees(got: ResponseSpectrum, deflection: Array, acceleration: Array, rtol: float) -> None:
    np.testing.assert_allclose(got.relative_displacement, deflection, rtol=rtol)
    np.testing.assert_allclose(got.absolute_acceleration, acceleration, rtol=rtol)
    np.testing.assert_allclose(got.pseudo_acceleration, RATES**2 * deflection, rtol=rtol)
    assert np.all(got.error.pseudo_acceleration < 10.0 * rtol * got.pseudo_acceleration)
    assert np.all(got.error.absolute_acceleration < 10.0 * rtol * got.absolute_acceleration)


@needs_kernels
def test_an_oscillator_behind_a_rigid_stop() -> None:
    def force(t: float) -> Array:
        return np.array([2.0 * np.cos(4.0 * t)])

    whole = Together(
        np.eye(1),
        np.array([[25.0]]),
        np.array([[0.2]]),
        [(0, 1.0, 0.1, 0.7)],
        0,
        RATES,
        0.05,
        force,
    )
    deflection, acceleration, count = whole.spectrum(np.zeros(1), np.array([0.8]), 2.0)
    motion = _struck(801, "impacts")
    assert motion.impacts.time.size == count > 1
    _agrees(motion.response_spectrum(0, RATES, unit="Omega"), deflection, acceleration, 1e-4)
    # Without the impacts, jumps are spread over an interval: (80 h)²/12 of 0.3 %, and a third of
    # a jump of 2 ζ Ω v in the acceleration of slow oscillators.
    spread = _struck(801).response_spectrum(0, RATES, unit="Omega")
    np.testing.assert_allclose(spread.relative_displacement, deflection, rtol=5e-3)
    np.testing.assert_allclose(spread.absolute_acceleration, acceleration, rtol=0.05)
    assert "impacts were not requested" in repr(spread)


@needs_kernels
def test_coupled_masses_on_a_measured_base() -> None:
    """The coordinate is not the one that is struck: its velocity jumps by the coupled masses."""
    times = np.arange(0.0, 1.001, 0.02)
    measured = 3.0 * np.sin(7.0 * times) + np.cos(19.0 * times)
    whole = Together(
        M, K, C, [(0, 1.0, 0.03, 0.8), (1, -1.0, 0.05, 0.6)], 1, RATES, 0.05,
        influence=np.ones(2), base=lambda t: float(np.interp(t, times, measured)),
    )  # fmt: skip
    start = np.array([0.4, 0.6])
    deflection, acceleration, count = whole.spectrum(np.zeros(2), start, 1.0)
    stops = [
        vi.constraint(0, {"lower": None, "upper": 0.03}, restitution=0.8),
        vi.constraint(1, {"lower": 0.05, "upper": None}, restitution=0.6),
    ]
    motion = vi.Local().time_history(
        vi.system(M, K, stops, C=C, units=SI), (np.zeros(2), start), 1.0, t=401,
        load=[vi.base_motion(np.ones(2), measured, interval=0.02)], outputs=["x", "v", "impacts"],
    )  # fmt: skip
    assert motion.impacts.time.size == count > 1
    _agrees(motion.response_spectrum(1, RATES, unit="Omega"), deflection, acceleration, 2e-4)


@needs_kernels
def test_an_elastic_stop_on_a_vibrating_base() -> None:
    whole = Together(
        M, K, C, [(0, 1.0, 0.02, 2e4, 20.0)], 1, RATES, 0.02,
        influence=np.ones(2), base=lambda t: -0.02 * 64.0 * np.cos(8.0 * t),
    )  # fmt: skip
    start = np.array([0.4, 0.6])
    deflection, acceleration, _ = whole.spectrum(np.zeros(2), start, 1.0)
    stop = vi.constraint(0, {"lower": None, "upper": 0.02}, stiffness=2e4, damping=20.0)
    motion = vi.Local().time_history(
        vi.system(M, K, [stop], C=C, units=SI, influence=np.ones(2)), (np.zeros(2), start), 1.0,
        t=2001, load=[vi.base_vibration("displacement", 0.02, 8.0)],
        outputs=["x", "v", "contacts"],
    )  # fmt: skip
    assert motion.contacts.start.size > 1
    _agrees(motion.response_spectrum(1, RATES, 0.02, "Omega"), deflection, acceleration, 2e-4)


def test_a_free_mass_between_walls_has_the_spectrum_of_a_triangle_wave() -> None:
    """Jumps follow from samples at any times, one of them at an impact."""
    t = np.sort(np.append(np.random.default_rng(1).uniform(0.0, 10.0, 400), [0.0, 3.5, 10.0]))
    phase = (2.0 * t + 1.0) % 4.0
    x = np.where(phase < 2.0, phase - 1.0, 3.0 - phase)
    v = np.where((phase > 0.0) & (phase <= 2.0), 2.0, -2.0)
    impulse = np.where(np.arange(10) % 2, 1.0, -1.0)
    jumps = Jumps(np.arange(0.5, 10.0), impulse, np.zeros(10, dtype=np.int64))
    starts = np.append(0.0, jumps.time)
    exact = Pieces(
        np.diff(starts, append=10.0), np.where(np.arange(11) % 2, -2.0, 2.0), np.zeros(11),
        np.zeros(11),
    )  # fmt: skip
    for frequency, damping in ((1.0, 0.0), (3.0, 0.05), (40.0, 0.3)):
        got = largest(Pieces.of(t, x, v, jumps), frequency, damping)
        assert got == pytest.approx(largest(exact, frequency, damping), rel=1e-4)


@needs_kernels
def test_it_prints_and_plots() -> None:
    spectrum = _struck(801, "impacts").response_spectrum(frequencies=(1.0, 20.0, 30))
    assert spectrum.frequencies.size == 30
    assert repr(spectrum).startswith(
        "<ResponseSpectrum of coordinate 0: 30 frequencies 1 to 20 Hz, damping 0.05, pseudo-"
    )
    assert "m/s^2 at" in repr(spectrum)
    ax = spectrum.plot()
    assert ax.get_xlabel() == "frequency (Hz)"
    np.testing.assert_array_equal(ax.lines[0].get_ydata(), spectrum.pseudo_acceleration)


@needs_kernels
def test_what_is_refused() -> None:
    motion = _struck(201, "impacts")
    with pytest.raises(ValueError, match=r"8 in its period.*t=1601"):
        motion.response_spectrum(0, [100.0])
    with pytest.raises(ValueError, match="dof 1 was not computed, but 0"):
        motion.response_spectrum(1, [1.0])
    for wrong in ([], [0.0], [-1.0], [np.nan]):
        with pytest.raises(ValueError, match="frequencies must be positive"):
            motion.response_spectrum(0, wrong)
    for ratio in (-0.1, 1.0):
        with pytest.raises(ValueError, match="damping must be at least 0 and below 1"):
            motion.response_spectrum(0, [1.0], ratio)
    with pytest.raises(ValueError, match="three output times"):
        _struck(2).response_spectrum(0, [0.1])
    local, start = vi.Local(), ([0.0], [0.8])
    bare = local.time_history(STRUCK, start, 1.0, t=50, outputs=["x"])
    with pytest.raises(ValueError, match="the result has no v"):
        bare.response_spectrum(0, [1.0])


@needs_kernels
def test_a_base_without_its_influence_is_refused() -> None:
    """A stored structure keeps its influence with the service, not in the request."""
    system = vi.oscillator([], influence=[1.0])
    load = [vi.base_vibration("acceleration", 1.0, 1.0)]
    motion = vi.Local().time_history(
        system, ([0.0], [0.0]), 5.0, t=200, load=load, outputs=["x", "v"]
    )
    document: Any = motion.request["system"]
    assert motion.response_spectrum(0, [1.0]).absolute_acceleration[0] > 0.0
    del document["influence"]
    with pytest.raises(ValueError, match="the influence of its system"):
        motion.response_spectrum(0, [1.0])
