"""Motions with elastic stops that others have published or that have closed forms.

Sources: the validation manual of code_aster, V5.01.101 (SDND101), V5.01.102 (SDND102), V5.01.108
and V5.01.122, with their data, and closed forms that follow from them by hand; S. W. Shaw and P. J.
Holmes, "A periodically forced piecewise linear oscillator", Journal of Sound and Vibration 90
(1983), whose motions are made of two linear ones.
"""

from __future__ import annotations

import math
from typing import Any

import mpmath
import numpy as np

from vibroimpact_solvers import time_history
from vibroimpact_solvers.laws import Linear
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

ALL = frozenset({"x", "v", "energy", "force", "contacts"})


def motion(system: System, x: Any, v: Any, t_end: float, **more: Any) -> Any:
    state = time_history.State(np.array(x, dtype=float), np.array(v, dtype=float))
    more = {"t": np.linspace(0.0, t_end, 31)} | more
    problem = time_history.Problem(system, state, t_end, outputs=ALL, **more)
    return time_history.solve(problem, time_history.plan(problem))


def one_mass(m: float, k: float, stop: Linear, gap: float, force: float = 0.0) -> System:
    M, K = SymmetricMatrix.diagonal([m]), SymmetricMatrix.diagonal([k])
    wall = Constraint((0,), (1.0,), None, gap, law=stop)
    return System(M, K, (wall,), force=np.array([force]))


def within(values: Any, true: Any, errors: Any, most: float) -> None:
    """Compare with the truth: off by no more than the stated errors, which are small."""
    assert (np.abs(np.asarray(values) - np.asarray(true)) <= np.asarray(errors)).all()
    assert np.max(errors) <= most


def test_released_against_an_elastic_stop() -> None:
    """SDND101: m = 100 kg, k = 1e4 N/m, a stop of 1e6 N/m without clearance, 1 m/s."""
    m, k, stop, v0 = 100.0, 1e4, 1e6, 1.0
    result = motion(one_mass(m, k, Linear(stop), 0.0), [0.0], [v0], 1.0)
    w, alone = math.sqrt((k + stop) / m), math.pi / math.sqrt(k / m)
    duration = math.pi / w
    starts = (duration + alone) * np.arange(result.contact_start.size)
    assert result.contact_start.size == 3
    within(result.contact_start, starts, result.error_contact_start, 1e-12)
    last = np.minimum(starts + duration, 1.0)
    within(result.contact_stop, last, result.error_contact_stop, 1e-12)
    # x = v0/w sin(w t), so that the force is at most stop v0/w and its impulse is 2 stop v0/w^2.
    for name, true in (
        ("peak_force", stop * v0 / w),
        ("impulse", 2.0 * stop * v0 / w**2),
        ("indentation", v0 / w),
        ("energy_lost", 0.0),
    ):
        values, errors = (
            getattr(result, f"contact_{name}"),
            getattr(result, f"error_contact_{name}"),
        )
        within(values, true, errors, 1e-9 * stop)


def test_a_wall_and_a_twin() -> None:
    """SDND102: a mass at a wall moves as one of two that meet their mirror image.

    Between both the stop is half as stiff: each end moves half of what it is compressed by.
    """
    m, k, stop, gap = 100.0, 1e4, 1e6, 5e-3
    load = time_history.Harmonic(0, 200.0, 9.0, 0.3)
    against = time_history.Harmonic(1, -200.0, 9.0, 0.3)
    wall = motion(one_mass(m, k, Linear(stop, 400.0), gap), [0.0], [0.2], 3.0, load=(load,))
    between = Constraint((0, 1), (1.0, -1.0), None, 2.0 * gap, law=Linear(stop / 2.0, 200.0))
    M, K = SymmetricMatrix.diagonal([m, m]), SymmetricMatrix.diagonal([k, k])
    pair = System(M, K, (between,))
    twins = motion(pair, [0.0, 0.0], [0.2, -0.2], 3.0, load=(load, against))
    assert wall.contact_start.size == twins.contact_start.size > 5
    for name in ("start", "stop", "impulse", "peak_force"):
        one, two = getattr(wall, f"contact_{name}"), getattr(twins, f"contact_{name}")
        errors = getattr(wall, f"error_contact_{name}") + getattr(twins, f"error_contact_{name}")
        within(one, two, errors, 1e-6)
    within(wall.x[:, 0], twins.x[:, 0], wall.error_x[:, 0] + twins.error_x[:, 0], 1e-10)
    within(twins.x[:, 0], -twins.x[:, 1], twins.error_x.sum(axis=1), 1e-10)


def test_a_mass_that_bounces_on_elastic_ground() -> None:
    """V5.01.108: it falls, and the phase of contact p has ``tan(w p/2) = - w v/g``."""
    m, k, g, height = 2.0, 5e4, 9.81, 0.5
    system = one_mass(m, 0.0, Linear(k), 0.0, force=m * g)  # downwards
    result = motion(system, [-height], [0.0], 3.0)
    with mpmath.workdps(30):
        fall = mpmath.sqrt(2 * mpmath.mpf(height) / mpmath.mpf(g))
        v, w = mpmath.mpf(g) * fall, mpmath.sqrt(mpmath.mpf(k) / m)
        contact = 2 * (mpmath.pi - mpmath.atan(w * v / mpmath.mpf(g))) / w
        deepest = mpmath.mpf(g) / w**2 + mpmath.sqrt((mpmath.mpf(g) / w**2) ** 2 + (v / w) ** 2)
        count = result.contact_start.size
        starts = [float(fall + i * (2 * fall + contact)) for i in range(count)]
    assert count == 5
    within(result.contact_start, starts, result.error_contact_start, 1e-12)
    stops = np.array(starts) + float(contact)
    within(result.contact_stop, stops, result.error_contact_stop, 1e-12)
    within(result.contact_indentation, float(deepest), result.error_contact_indentation, 1e-12)
    peak = float(k * deepest)
    within(result.contact_peak_force, peak, result.error_contact_peak_force, 1e-8)
    impulse = float(2 * m * v + m * mpmath.mpf(g) * contact)
    within(result.contact_impulse, impulse, result.error_contact_impulse, 1e-9)


def test_a_nonlinear_mode_with_an_elastic_wall() -> None:
    """V5.01.122: k = 10 N/m, m = 1 kg, a wall of 50 N/m at 0.01 m; period by energy."""
    k, stop, gap = 10.0, 50.0, 0.01
    for energy in (1e-3, 1e-2, 1.0):
        speed = math.sqrt(2.0 * energy)
        result = motion(one_mass(1.0, k, Linear(stop), gap), [0.0], [speed], 20.0)
        w, both = math.sqrt(k), math.sqrt(k + stop)
        at_wall = math.sqrt(2.0 * energy - k * gap**2)
        apart = (2.0 * math.pi - 2.0 * math.acos(gap * w / speed)) / w
        place = k * gap / (k + stop)  # of the wall from where both springs are in balance
        pressed = 2.0 * math.acos(place / math.hypot(place, at_wall / both)) / both
        starts = math.asin(gap * w / speed) / w + (apart + pressed) * np.arange(
            result.contact_start.size
        )
        assert result.contact_start.size > 9
        within(result.contact_start, starts, result.error_contact_start, 1e-10)


def test_a_forced_piecewise_linear_oscillator() -> None:
    """Shaw and Holmes: ``x'' + 2 d x' + x + k max(0, x - 1) = cos(w t)``, piece by piece."""
    d, k, w, amplitude, t_end = 0.05, 6.0, 0.8, 1.5, 40.0
    M, K = SymmetricMatrix.diagonal([1.0]), SymmetricMatrix.diagonal([1.0])
    wall = Constraint((0,), (1.0,), None, 1.0, law=Linear(k))
    system = System(M, K, (wall,), C=SymmetricMatrix.diagonal([2.0 * d]))
    load = (time_history.Harmonic(0, amplitude, w),)
    result = motion(system, [0.0], [0.0], t_end, load=load, t=np.array([t_end]))
    with mpmath.workdps(30):
        starts, stops, end = _pieces(d, k, w, amplitude, t_end)
    assert result.contact_start.size == len(starts) > 4
    within(result.contact_start, starts, result.error_contact_start, 1e-10)
    within(result.contact_stop[: len(stops)], stops, result.error_contact_stop[: len(stops)], 1e-10)
    within(result.x[-1, 0], end, result.error_x[-1, 0], 1e-10)


def _pieces(
    d: float, k: float, w: float, amplitude: float, t_end: float
) -> tuple[list[float], list[float], float]:
    """Return starts and stops of contacts and the last displacement, by matching two solutions."""
    t, x, v, loaded = mpmath.mpf(0), mpmath.mpf(0), mpmath.mpf(0), False
    starts: list[float] = []
    stops: list[float] = []
    d, w = mpmath.mpf(d), mpmath.mpf(w)
    while True:
        stiffness = mpmath.mpf(1 + k if loaded else 1)
        still = mpmath.mpf(k if loaded else 0) / stiffness
        response = mpmath.mpf(amplitude) / mpmath.mpc(stiffness - w * w, 2 * d * w)
        own = mpmath.sqrt(stiffness - d * d)

        def steady(s: Any, response: Any = response, still: Any = still) -> tuple[Any, Any]:
            turned = response * mpmath.expj(w * s)
            return still + turned.real, (mpmath.mpc(0, w) * turned).real

        q, rate = x - steady(t)[0], v - steady(t)[1]

        def at(s: Any, t0: Any = t, q: Any = q, rate: Any = rate, own: Any = own) -> Any:
            span = s - t0
            decay, c, sn = mpmath.exp(-d * span), mpmath.cos(own * span), mpmath.sin(own * span)
            free = decay * (q * c + (rate + d * q) / own * sn)
            speed = decay * (rate * c - (d * rate + (own * own + d * d) * q) / own * sn)
            return steady(s)[0] + free, steady(s)[1] + speed

        step, s, sign = mpmath.mpf("0.01"), t + mpmath.mpf("1e-6"), -1 if loaded else 1
        while s < t_end and sign * (at(s + step)[0] - 1) < 0:
            s += step
        if s >= t_end or s + step >= t_end:
            return starts, stops, float(at(mpmath.mpf(t_end))[0])
        t = mpmath.findroot(lambda s: at(s)[0] - 1, (s, s + step), solver="anderson", tol=1e-25)
        x, v = at(t)
        (stops if loaded else starts).append(float(t))
        loaded = not loaded
