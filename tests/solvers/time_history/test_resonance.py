"""Harmonic loads at a natural frequency, or all but at it, against closed forms and mpmath."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
from scipy.optimize import brentq

from tests.solvers.time_history.test_free_motion import compare
from tests.truth import histories
from vibroimpact_solvers import presets, spectrum
from vibroimpact_solvers import time_history as th
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

OUTPUTS = frozenset({"x", "v", "impacts"})


def test_an_oscillator_at_resonance_grows_like_t() -> None:
    """x'' + x = F cos(t + phase): x = (F/2) t sin(t + phase) + what the start asks for."""
    system = presets.oscillator([Constraint.at(0, 1e6)], 1.0)
    F, phase, t = 0.3, 0.4, np.linspace(0.0, 500.0, 101)
    problem = th.Problem(
        system,
        th.State(np.zeros(1), np.zeros(1)),
        500.0,
        t=t,
        outputs=OUTPUTS,
        load=(th.Harmonic(0, F, 1.0, phase),),
    )
    result = th.solve(problem, th.plan(problem))
    assert result.x is not None
    assert result.v is not None
    x = 0.5 * F * (t * np.sin(t + phase) - np.sin(t) * np.sin(phase))
    v = 0.5 * F * (t * np.cos(t + phase) + np.sin(t + phase) - np.cos(t) * np.sin(phase))
    np.testing.assert_allclose(result.x[:, 0], x, rtol=0.0, atol=1e-13 * 75.0)
    np.testing.assert_allclose(result.v[:, 0], v, rtol=0.0, atol=1e-13 * 75.0)


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("detuning", [0.0, 1e-9, 4e-4])
def test_impacts_of_a_chain_driven_near_resonance(detuning: float) -> None:
    """Against the exact motion just beside resonance: the two differ by the detuning's part."""
    system = presets.chain(3, [Constraint.at(1, 0.3, 0.8)])
    omega = float(spectrum.spectrum(system).roots[0])
    near = omega * (1.0 + detuning)
    if abs(near - omega) < 1e-13:
        near = np.nextafter(omega, 2.0)  # no load of the reference may be at resonance
    load = [th.Harmonic(0, 0.05, near, 0.3)]
    x, v = np.array([0.05, 0.0, -0.05]), np.array([0.0, 0.2, 0.1])
    result, worst = compare(system, x, v, 30.0, 0.05, load)
    assert result.count_impacts > 5
    assert worst < 4.0


def test_a_lightly_damped_structure_near_resonance() -> None:
    C = SymmetricMatrix.dense(np.diag([1e-5, 1e-5]))
    K = np.array([[2.0, -1.0], [-1.0, 2.0]])
    system = System(
        SymmetricMatrix.diagonal([1.0, 1.0]),
        SymmetricMatrix.dense(K),
        (Constraint.at(0, 0.2, 0.9),),
        C=C,
    )
    load = [th.Harmonic(0, 0.1, 1.0), th.Harmonic(1, 0.05, 1.0001, 1.0)]
    result, worst = compare(system, np.zeros(2), np.array([0.3, 0.0]), 20.0, 0.05, load)
    assert result.count_impacts > 5
    assert worst < 4.0


def test_release_from_a_wall_at_resonance() -> None:
    """While mass 0 rests, mass 1 is driven at its own frequency sqrt(2): x1 grows like t.

    M = 1, K = [[2, -1], [-1, 2]], k = 0; mass 0 is pressed on its wall at g by x1 - 2 g and is
    released when that vanishes. x1'' + 2 x1 = g + F cos(sqrt(2) t), to 30 digits.
    """
    g, F, omega = 0.1, 0.02, np.sqrt(2.0)
    K = np.array([[2.0, -1.0], [-1.0, 2.0]])
    system = System(
        SymmetricMatrix.diagonal([1.0, 1.0]),
        SymmetricMatrix.dense(K),
        (Constraint((0,), (1.0,), None, g, 0.0),),
    )
    start = 0.3
    problem = th.Problem(
        system,
        th.State(np.array([g, start]), np.zeros(2)),
        6.0,
        outputs=frozenset({"contacts"}),
        load=(th.Harmonic(1, F, float(omega)),),
    )
    result = th.solve(problem, th.plan(problem))
    with mp.workdps(30):
        w = mp.mpf(float(omega))

        def moved(t: mp.mpf) -> mp.mpf:
            free = (mp.mpf(start) - mp.mpf(g) / 2) * mp.cos(mp.sqrt(2) * t) + mp.mpf(g) / 2
            # the response between two frequencies that differ by a rounding
            low, high = (w - mp.sqrt(2)) / 2, (w + mp.sqrt(2)) / 2
            drive = mp.mpf(F) * mp.sin(high * t) * mp.sin(low * t) / low / (2 * high)
            return free + drive - 2 * mp.mpf(g)

        release = mp.findroot(moved, (0.4, 1.2), "anderson")
    assert result.contact_stop is not None
    np.testing.assert_allclose(result.contact_stop[0], float(release), rtol=1e-14)


@pytest.mark.parametrize(("periods", "part"), [(20, 1e-4), (50, 1e-3), (200, 1e-6)])
def test_a_motion_that_grows_in_resonance_does_not_pass_its_wall(periods: int, part: float) -> None:
    """From rest under 2 cos t the motion is t sin t; its maximum just reaches the wall."""
    top = brentq(
        lambda t: np.sin(t) + t * np.cos(t), 2 * np.pi * periods + 1.0, 2 * np.pi * periods + 2.5
    )
    wall = top * np.sin(top) * (1.0 - part)
    exact = brentq(lambda t: t * np.sin(t) - wall, top - 1.0, top, xtol=1e-14)
    problem = th.Problem(
        presets.oscillator([Constraint.at(0, wall)], 1.0),
        th.State(np.zeros(1), np.zeros(1)),
        top + 2.0,
        load=(th.Harmonic(0, 2.0, 1.0),),
        outputs=frozenset({"impacts"}),
    )
    result = th.solve(problem, th.plan(problem))
    assert result.impact_time is not None
    # A time of 1e-13 relative at a slope that vanishes with the distance to the maximum.
    np.testing.assert_allclose(result.impact_time[0], exact, rtol=0.0, atol=1e-11)


def test_a_mode_that_is_still_where_the_damping_acts_is_not_damped_by_rounding() -> None:
    """The second mode of three equal masses, driven at its frequency, with a damper in the middle.

    What rounding makes of the zero in the middle coupled it to the others, whose response to the
    load was then 1e14 times the motion.
    """
    document = {
        "M": np.eye(3).tolist(), "K": [[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 2.0]],
        "C": [[0.0, 0.0, 0.0], [0.0, 0.07075102131305813, 0.0], [0.0, 0.0, 0.0]],
        "constraints": [{"dofs": [2], "weights": [1.0], "lower": 0.27, "upper": 0.27,
                         "restitution": 0.30796345648502976}],
        "x": [0.0, 0.0, 0.0], "v": [-0.45073121328871957, 0.7451521527576483, -0.1507834047467297],
        "load": [[0, 0.5113411670217842, 1.414213562373095, -0.38383300087589367],
                 [2, 0.2926393878914538, 0.33212526208218957, 0.48293565583308773]],
        "t": [0.05164615492779719, 1.0, 2.0], "t_end": 3.0,
    }  # fmt: skip
    report = histories.checked(document)
    assert report.counts["horizon at the end"] == 1
