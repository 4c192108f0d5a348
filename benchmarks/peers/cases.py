"""The motions that integrators are compared on, with their answers in extended precision."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import mpmath
import numpy as np

from benchmarks.cases import GAP, IMPULSE
from benchmarks.peers.scene import Outcome, Scene
from vibroimpact_solvers import impact_modes, presets, spectrum
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.time_history import Harmonic, Power

_LEAST: Final = 1e-17
"""Errors are not shown as less."""


@dataclass(frozen=True, slots=True)
class Case:
    """A motion and its answer.

    Parameters
    ----------
    name, title : str
    scene : Scene
    impacts : int
        How many there are; 0 where they are not counted.
    error : callable
        The error of an outcome in which no impact is missing.
    step : float
        Steps of this length miss no impact.
    without : frozenset of str
        Integrators that this is not for.
    """

    name: str
    title: str
    scene: Scene
    impacts: int
    error: Callable[[Outcome], float]
    step: float = math.inf
    without: frozenset[str] = frozenset()

    @property
    def label(self) -> str:
        """Name and title."""
        return f"{self.name}: {self.title}"

    def missed(self, outcome: Outcome) -> int:
        """Return how many impacts are missing."""
        return max(0, self.impacts - len(outcome.times))

    def judged(self, outcome: Outcome) -> tuple[int, float]:
        """Return the number of impacts missing and the error, nan where some are."""
        missed = self.missed(outcome)
        if missed or not np.isfinite(outcome.state).all():
            return missed, float("nan")
        return 0, max(_LEAST, self.error(outcome))


def oscillator() -> Case:
    """Return case A: one mass, Omega = 1, walls at +-1, k = 0.95, x = 0, v = 5, 100 impacts.

    A free motion from wall to wall with speed u takes 2 arctan(1/u), here to 30 digits. Compared is
    the time of the hundredth impact.
    """
    with mpmath.workdps(30):
        k, speed = mpmath.mpf("0.95"), mpmath.sqrt(24)
        t, times = mpmath.asin(mpmath.mpf(1) / 5), []
        for _ in range(101):
            times.append(t)
            speed *= k
            t += 2 * mpmath.atan(1 / speed)
        end, last = float((times[99] + times[100]) / 2), times[99]
    system = presets.oscillator([Constraint.at(0, 1.0, 0.95)], 1.0)
    scene = Scene(system, np.array([0.0, 5.0]), end)
    return Case(
        "A",
        "oscillator, k=0.95, 100 impacts",
        scene,
        100,
        lambda outcome: abs(float(outcome.times[99] / last - 1)),
        step=0.02,
    )


def from_mode(n: int, dof: int, omega: float, periods: int) -> Scene:
    """Return an elastic chain that starts on its impact mode, at tau = 0."""
    system = presets.chain(n, [Constraint.at(dof, GAP)])
    natural = spectrum.spectrum(system)
    problem_at = impact_modes.Problem(system, np.array([omega]), outputs=IMPULSE)
    impulse = impact_modes.solve(problem_at, impact_modes.plan(problem_at)).impulse
    assert impulse is not None
    # x = p/omega^2 sum e_j a_j sin(gamma tau)/(gamma cos gamma), eq. 10.47, at tau = 0.
    gamma = natural.roots / omega
    amplitude = natural.rows(np.array([dof]))[0] / np.cos(gamma)
    v = impulse[0, 0] / omega * (natural.modes @ amplitude)
    return Scene(system, np.concatenate([np.zeros(n), v]), periods * 4.0 / omega)


def _closes(state: Floats) -> Callable[[Outcome], float]:
    """Return what compares a final state with this one."""
    return lambda outcome: float(np.abs(outcome.state - state).max() / np.abs(state).max())


def short_chains() -> Iterator[Case]:
    """Yield cases B: a chain of 13 masses on an impact mode, for one period and for ten.

    After whole periods the first state is there again, to its rounding, which the unstable mode
    magnifies.
    """
    roots = spectrum.spectrum(presets.chain(13, [Constraint.at(5, GAP)])).roots
    omega = 2.0 / np.pi * roots[4] + 0.02
    for periods in (1, 10):
        scene = from_mode(13, 5, omega, periods)
        title = f"chain N=13, elastic, {periods} period{'s' if periods > 1 else ''}"
        yield Case("B", title, scene, 2 * periods, _closes(scene.state), 1.0 / omega)


def long_chain(n: int) -> Case:
    """Return case C: a chain on an impact mode above its spectrum, for ten periods.

    What it is compared with is known as the first state is: in extended precision the motion
    from that state closes to 1e-14 after ten periods.
    """
    top = 2.0 * math.sin(n * math.pi / (2 * n + 2))
    omega = 1.5 * 2.0 / np.pi * top
    scene = from_mode(n, n // 2 - 1, omega, 10)
    heavy = {"diffrax Dopri8", "Siconos, time stepping", "Siconos, event-driven"}
    without = frozenset(heavy) if n > 100 else frozenset[str]()
    title = f"chain N={n}, elastic, 10 periods"
    return Case("C", title, scene, 20, _closes(scene.state), 1.0 / omega, without)


def driven() -> Case:
    """Return case D: two damped masses, driven, between three unequal walls, k = 0.7.

    Compared are the final state and the times of all impacts.
    """
    K = np.array([[2.0, -1.0], [-1.0, 2.0]])
    walls = (Constraint((0,), (1.0,), 0.5, 0.3, 0.7), Constraint((1,), (1.0,), None, 0.4, 0.7))
    one, C = SymmetricMatrix.diagonal([1.0, 1.0]), SymmetricMatrix.dense(0.02 * (np.eye(2) + K))
    system = System(one, SymmetricMatrix.dense(K), walls, C=C)
    load = (Harmonic(0, 1.5, 1.7),)
    scene = Scene(system, np.array([0.0, 0.0, 0.5, 0.2]), 300.0, load)
    return _against_exact("D", "two driven masses, three walls, k=0.7", scene, 0.1)


def _against_exact(name: str, title: str, scene: Scene, step: float) -> Case:
    times, state = _exact(name)
    closes = _closes(state)

    def error(outcome: Outcome) -> float:
        if len(outcome.times) != len(times):  # some too many
            return closes(outcome)
        late = np.abs(np.subtract(outcome.times, times)).max()
        return max(float(late) / max(1.0, times[-1]), closes(outcome))

    return Case(name, title, scene, len(times), error, step)


def _exact(name: str) -> tuple[list[float], Floats]:
    """Return times of impacts and final state of a case, of which a test finds all digits."""
    stored = json.loads(Path(__file__).with_name("exact.json").read_text())[name]
    return stored["times"], np.array(stored["state"])


def ball() -> Case:
    """Return case E: a ball dropped from 1 m, k = 0.9, to t = 20.

    It strikes the floor infinitely often before it rests at t = 8.5789... s. Compared are
    the time of its last impact with that, and where it is in the end.
    """
    system = presets.bouncing_ball([Constraint((0,), (1.0,), 0.0, None, 0.9)])
    scene = Scene(system, np.array([1.0, 0.0]), 20.0, most=400)
    with mpmath.workdps(30):
        rest = mpmath.sqrt(2 / mpmath.mpf(9.81)) * (1 + mpmath.mpf(0.9)) / (1 - mpmath.mpf(0.9))

    def error(outcome: Outcome) -> float:
        late = abs(float(outcome.times[-1] / rest - 1)) if outcome.times else 1.0
        return max(late, abs(float(outcome.state[0])))

    return Case("E", "bouncing ball, to its rest", scene, 0, error)


def two_limiters() -> Case:
    """Return case F: a random start of a chain of 12 masses between two pairs of lossy walls.

    Dofs 4 and 8, k = 0.9: chaotic. It is followed until the time to which double precision
    tells anything, and compared as D is.
    """
    walls = [Constraint.at(4, GAP, 0.9), Constraint.at(8, GAP, 0.9)]
    random = np.random.default_rng(12)
    x, v = 0.3 * GAP * random.uniform(-1.0, 1.0, 12), random.standard_normal(12)
    scene = Scene(presets.chain(12, walls), np.concatenate([x, v]), 75.2)
    return _against_exact("F", f"two limiters, chaotic, to t={scene.t_end:g}", scene, 0.02)


def soft() -> Case:
    """Return case S: two coupled masses, one between soft limiters (y / gap)^17, to t = 40."""
    system = presets.two_mass([Constraint.at(0, 0.5)], 1.0)
    state = np.array([0.0, 0.0, 1.0, 0.4])
    scene = Scene(system, state, 40.0, limiter=Power(17.0, 1.0, 1.0))
    _, exact = _exact("S")
    names = frozenset({"Siconos, time stepping", "Siconos, event-driven"})
    return Case("S", "two masses, soft limiters, power 17", scene, 0, _closes(exact), without=names)


def every() -> Iterator[Case]:
    """Yield all cases."""
    yield oscillator()
    yield from short_chains()
    yield long_chain(100)
    yield long_chain(1000)
    yield driven()
    yield ball()
    yield two_limiters()
    yield soft()
