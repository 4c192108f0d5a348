"""Time histories: run time against error, and impacts missed, against general integrators."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Final

import mpmath
import numpy as np

from benchmarks.harness import Timing, measure, ratio
from benchmarks.peers import PEERS, Integrator, Outcome, Scene, installed, settings, solve_ivp
from benchmarks.tables import Goal, Plot, Table
from vibroimpact_solvers import impact_modes, presets, spectrum, time_history
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.model import Constraint, System
from vibroimpact_solvers.time_history import Problem, State

_MICRO = 1e6
_TOLERANCES: Final = (1e-6, 1e-9, 1e-12, 1e-15)
_GAP = 0.2


def ours(system: System, scene: Scene) -> Outcome:
    """Plan and solve, as the service does: the impacts and the state at the end."""
    n = scene.n
    problem = Problem(
        system,
        State(scene.state[:n], scene.state[n:]),
        scene.t_end,
        t=np.array([scene.t_end]),
        outputs=frozenset({"impacts", "x", "v"}),
    )
    found = time_history.solve(problem, time_history.plan(problem))
    assert found.impact_time is not None
    assert found.x is not None
    assert found.v is not None
    return Outcome(tuple(found.impact_time.tolist()), np.concatenate([found.x[0], found.v[0]]))


def prepared(system: System, scene: Scene, *, estimate: bool) -> Callable[[], Outcome]:
    """Return what solves a motion that was planned and prepared beforehand, as peers are.

    Parameters
    ----------
    estimate : bool
        Whether errors are estimated, which no peer does.
    """
    n = scene.n
    state = State(scene.state[:n], scene.state[n:])
    problem = Problem(
        system,
        state,
        scene.t_end,
        t=np.array([scene.t_end]),
        outputs=frozenset({"impacts", "x", "v"}),
        estimate=estimate,
    )
    motion = time_history.prepare(problem, time_history.plan(problem))
    # The peers get their state anew each time; so does this.
    again = State(scene.state[:n].copy(), scene.state[n:].copy())

    def run() -> Outcome:
        found = motion.solve(again)
        assert found.impact_time is not None
        assert found.x is not None
        assert found.v is not None
        return Outcome(tuple(found.impact_time.tolist()), np.concatenate([found.x[0], found.v[0]]))

    return run


def oscillator() -> tuple[System, Scene, list[float]]:
    """Return case A, with the times of its impacts to 30 digits, rounded.

    One mass, Omega = 1, walls at +-1, k = 0.95, x = 0, v = 5, 100 impacts. A flight from wall
    to wall with speed u takes 2 arctan(1/u).
    """
    with mpmath.workdps(30):
        k, speed = mpmath.mpf("0.95"), mpmath.sqrt(24)
        t, times = mpmath.asin(mpmath.mpf(1) / 5), []
        for _ in range(101):
            times.append(t)
            speed *= k
            t += 2 * mpmath.atan(1 / speed)
        end = float((times[99] + times[100]) / 2)
    system = presets.oscillator([Constraint.at(0, 1.0, 0.95)], 1.0)
    scene = Scene(np.eye(1), 0, 1.0, 0.95, np.array([0.0, 5.0]), end)
    return system, scene, [float(t) for t in times[:100]]


def from_mode(n: int, dof: int, omega: float, periods: int) -> tuple[System, Scene, Floats]:
    """Return an elastic chain that starts on its impact mode, at tau = 0, and its first state."""
    system = presets.chain(n, [Constraint.at(dof, _GAP)])
    natural = spectrum.spectrum(system)
    problem = impact_modes.Problem(system, np.array([omega]), outputs=frozenset({"impulse"}))
    impulse = impact_modes.solve(problem, impact_modes.plan(problem)).impulse
    assert impulse is not None
    # x = p/omega^2 sum e_j a_j sin(gamma tau)/(gamma cos gamma), eq. 10.47, at tau = 0.
    gamma = natural.roots / omega
    amplitude = natural.rows(np.array([dof]))[0] / np.cos(gamma)
    v = impulse[0, 0] / omega * (natural.modes @ amplitude)
    state = np.concatenate([np.zeros(n), v])
    scene = Scene(system.K.to_dense(), dof, _GAP, 1.0, state, periods * 4.0 / omega)
    return system, scene, state


def _errors(case: str, outcome: Outcome, exact: Any) -> tuple[int, float]:
    """Return how many impacts are missing, and the error of what was found."""
    if case == "A":
        missing = max(0, len(exact) - len(outcome.times))
        if missing or not outcome.times:
            return missing, float("nan")
        return 0, max(1e-17, abs(outcome.times[99] / exact[99] - 1.0))
    count, state = exact
    missing = max(0, count - len(outcome.times))
    error = float(np.abs(outcome.state - state).max() / np.abs(state).max())
    return missing, max(1e-17, error)


def cases() -> list[tuple[str, str, System, Scene, Any]]:
    """Return the cases with their exact answers."""
    found: list[tuple[str, str, System, Scene, Any]] = []
    system, scene, times = oscillator()
    found.append(("A", "oscillator, k=0.95, 100 impacts", system, scene, times))
    roots = spectrum.spectrum(presets.chain(13, [Constraint.at(5, _GAP)])).roots
    omega = 2.0 / np.pi * roots[4] + 0.02
    for periods in (1, 10):
        system, scene, state = from_mode(13, 5, omega, periods)
        title = f"chain N=13, elastic, {periods} period{'s' if periods > 1 else ''}"
        found.append(("B", title, system, scene, (2 * periods, state)))
    top = 2.0 * math.sin(100 * math.pi / 202)
    system, scene, state = from_mode(100, 49, 1.5 * 2.0 / np.pi * top, 10)
    found.append(("C", "chain N=100, elastic, 10 periods", system, scene, (20, state)))
    return found


def work_precision() -> Table:
    """Run time against error from loose to tight tolerances, all integrators in one run.

    A: error of the time of the hundredth impact. B and C: error of the state after whole
    periods of an impact mode, whose first state is exact to rounding; the modes are unstable,
    which magnifies that rounding.
    """
    rows: list[tuple[Any, ...]] = []
    for case, title, system, scene, exact in cases():
        prepared: list[tuple[str, float | None, Integrator]] = [
            ("Vibroimpact", None, partial(ours, system))
        ]
        for name in installed():
            if case == "C" and name not in {"heyoka", "scipy DOP853"}:
                continue
            if name == "diffrax Dopri8" and case != "A":
                continue
            for tolerance in _tolerances(name):
                prepared.append((name, tolerance, PEERS[name][1](tolerance)(scene)))
        for name, setting, run in prepared:
            missing, error = _errors(case, run(scene), exact)
            timed = measure(rounds=3, sample=0.0, run=partial(run, scene))["run"]
            shown = "–" if setting is None else f"{setting:g}"
            rows.append((f"{case}: {title}", name, shown, timed.processor * 1e3, missing, error))
    return Table(
        "Run time against error: time histories",
        ("case", "integrator", "tolerance", "time [ms]", "impacts missed", "error"),
        rows,
        f"Time of the processor, one core, compiled beforehand. {settings()}. Relative "
        "tolerances; absolute ones are a hundredth of them. No number: impacts are missing.",
        plots=(Plot("time [ms]", "error", by="integrator", panel="case"),),
    )


def _tolerances(name: str) -> Sequence[float]:
    if name == "heyoka":
        return (1e-9, 1e-12, 2.0**-52)
    if name.startswith("scipy"):
        return (1e-6, 1e-9, 1e-12, 2.5e-14)
    return (1e-6, 1e-9, 1e-12)


def against_heyoka() -> Table:
    """Compare with heyoka at full precision, taking turns in one run."""
    if "heyoka" not in installed():
        return Table("Against heyoka", ("case",), [], "heyoka is not installed")
    rows = []
    goals = {"A": 8.0, "B": 8.0, "C": 5.0}
    for case, title, system, scene, _ in cases():
        peer = PEERS["heyoka"][1](2.0**-52)(scene)
        goal = None if title.endswith("1 period") else goals[case]
        found, impacts = _turns(7, system, scene, partial(peer, scene))
        each = [found[name].processor / impacts * _MICRO for name in _WAYS]
        times = [ratio(found["heyoka"], found[name]) for name in _WAYS[:3]]
        rows.append((f"{case}: {title}", impacts, *each, *times, goal))
    return Table(
        "Against heyoka",
        (
            "case",
            "impacts",
            "prepared [µs/impact]",
            "with errors [µs/impact]",
            "whole call [µs/impact]",
            "heyoka [µs/impact]",
            "times faster",
            "with errors, times faster",
            "whole call, times faster",
            "goal",
        ),
        rows,
        "Like with like: heyoka's integrator is made beforehand and gets a state, and so does the "
        "prepared motion; with errors it also tells how far it can be trusted. Whole call: "
        "problem, plan and solution, with errors.",
        Goal("times faster", "goal", at_least=True),
    )


_WAYS: Final = ("prepared", "with errors", "whole", "heyoka")


def _turns(
    rounds: int, system: System, scene: Scene, peer: Callable[[], Outcome] | None
) -> tuple[dict[str, Timing], int]:
    """Return times of the ways to a motion, taking turns, and its impacts."""
    functions: dict[str, Any] = {
        "prepared": prepared(system, scene, estimate=False),
        "with errors": prepared(system, scene, estimate=True),
        "whole": partial(ours, system, scene),
    }
    impacts = len(functions["prepared"]().times)
    if peer is not None:
        functions["heyoka"] = peer
    return measure(rounds, **functions), impacts


_FLOORS: Final = {13: 0.25, 100: 1.1, 1000: 10.0}
"""Three evaluations and one advance of all modes, µs, by the number of modes."""


def long_motions() -> Table:
    """Compare with heyoka in elastic motions with many impacts, where starting costs nothing."""
    rows: list[tuple[Any, ...]] = []
    for title, n, dof, factor, periods, goal in (
        ("oscillator", 1, 0, 1.5, 5000, 8.0),
        ("chain N=13", 13, 5, 1.5, 500, 8.0),
        ("chain N=100", 100, 49, 1.5, 250, 5.0),
        ("chain N=1000", 1000, 499, 1.5, 20, 3.0),
    ):
        top = spectrum.spectrum(presets.chain(n, [Constraint.at(dof, _GAP)])).largest_frequency
        system, scene, _ = from_mode(n, dof, factor * 2.0 / np.pi * top, periods)
        there = n < 1000 and "heyoka" in installed()
        integrator = PEERS["heyoka"][1](2.0**-52)(scene) if there else None
        peer = None if integrator is None else partial(integrator, scene)
        found, impacts = _turns(3, system, scene, peer)
        each = [
            found[name].processor / impacts * _MICRO if name in found else None for name in _WAYS
        ]
        times = None
        if peer is not None:
            theirs = len(peer().times)
            each[3] = found["heyoka"].processor / theirs * _MICRO
            times = found["heyoka"].processor / theirs / (found["prepared"].processor / impacts)
        floor = _FLOORS.get(n)
        best = found["prepared"].processor / impacts * _MICRO
        above = None if floor is None else best / floor
        rows.append((title, impacts, *each, above, times, goal if times else None))
    return Table(
        "Against heyoka, long motions",
        (
            "case",
            "impacts",
            "prepared [µs/impact]",
            "with errors [µs/impact]",
            "whole call [µs/impact]",
            "heyoka [µs/impact]",
            "over the floor",
            "times faster",
            "goal",
        ),
        rows,
        "heyoka at full double precision; a thousand masses take it minutes to compile. The floor "
        "is three evaluations of the constrained coordinate and one advance of all modes: "
        "0.25, 1.1 and 10 µs for 13, 100 and 1000 modes.",
        Goal("times faster", "goal", at_least=True),
    )


def stress() -> Table:
    """Follow one motion through ten million impacts: time, energy, and the last impact."""
    count = 10**7
    with mpmath.workdps(40):
        half = mpmath.asin(mpmath.mpf(1) / 5)
        end, last = float(2 * half * count), half * (2 * count - 1)
    system = presets.oscillator([Constraint.at(0, 1.0)], 1.0)
    state = State(np.zeros(1), np.array([5.0]))
    problem = Problem(system, state, end, estimate=False)
    motion = time_history.prepare(problem, time_history.plan(problem))
    motion.solve()
    start = time.process_time()
    found = motion.solve()
    seconds = time.process_time() - start
    assert found.impact_time is not None
    assert found.impact_velocity is not None
    row = (
        found.count_impacts,
        seconds / found.count_impacts * _MICRO,
        abs(float(found.impact_time[-1] / last - 1)),
        float(np.abs(np.abs(found.impact_velocity) / math.sqrt(24.0) - 1.0).max()),
    )
    return Table(
        "Ten million impacts",
        ("impacts", "[µs/impact]", "error of the last time", "largest error of a velocity"),
        [row],
        "Elastic oscillator between walls; errors are relative, times known to 40 digits.",
    )


def bouncing_ball() -> Table:
    """Drop a ball from 1 m, k = 0.9: infinitely many impacts before it rests at 8.5789… s."""
    exact = math.sqrt(2.0 / 9.81) * 1.9 / 0.1
    system = presets.bouncing_ball([Constraint((0,), (1.0,), 0.0, None, 0.9)])
    problem = Problem(
        system,
        State(np.array([1.0]), np.array([0.0])),
        20.0,
        t=np.array([20.0]),
        outputs=frozenset({"impacts", "contacts", "x", "v"}),
    )
    rows: list[tuple[Any, ...]] = []
    found = time_history.solve(problem, time_history.plan(problem))
    assert found.contact_rest is not None
    assert found.x is not None
    timed = measure(rounds=5, ours=lambda: time_history.solve(problem, time_history.plan(problem)))[
        "ours"
    ]
    rest = float(found.contact_rest[0])
    rows.append(("Vibroimpact", "rests", abs(rest / exact - 1.0), float(found.x[0, 0]), timed.wall))
    rows += [_scipy_ball(method) for method in ("DOP853", "LSODA")]
    return Table(
        "E: the bouncing ball",
        ("integrator", "outcome", "error of the time of rest", "x at t = 20", "time [s]"),
        rows,
        "Peers are stopped after 10⁴ impacts or when an impact is no later than the last.",
    )


def _scipy_ball(method: str) -> tuple[Any, ...]:
    def floor(t: float, y: Floats) -> float:
        return float(y[0])

    floor.terminal, floor.direction = True, -1.0  # type: ignore[attr-defined]
    state: dict[str, Any] = {}

    def fall(t: float, y: Floats) -> Any:
        return solve_ivp(
            lambda t, y: [y[1], -9.81],
            (t, 20.0),
            y,
            method=method,
            rtol=1e-10,
            atol=1e-12,
            events=floor,
        )

    def run() -> None:
        t, y, outcome, count = 0.0, np.array([1.0, 0.0]), "falls through the floor", 0
        while t < 20.0:
            try:
                found = fall(t, y)
            except ValueError:
                outcome = "throws"
                break
            if found.status != 1:
                break
            count += 1
            if found.t[-1] <= t or count >= 10_000:
                outcome = "stalls"
                break
            t, y = found.t[-1], np.array([0.0, -0.9 * found.y[1, -1]])
        state.update(t=t, y=float(found.y[0, -1]), outcome=outcome)

    timed = measure(rounds=1, sample=0.0, run=run)["run"]
    exact = math.sqrt(2.0 / 9.81) * 1.9 / 0.1
    return (
        f"scipy {method}",
        state["outcome"],
        abs(state["t"] / exact - 1.0),
        state["y"],
        timed.wall,
    )


def two_limiters() -> Table:
    """Follow a random start of a chain of 12 masses between two pairs of lossy walls.

    F: dofs 4 and 8, k = 0.9, t = 200. Chaotic: past the time that is flagged no method in double
    precision is right, and impacts are compared before it. The reference is scipy's DOP853 at
    its tightest tolerance in steps no longer than a fiftieth, which see every crossing.
    """
    walls = [Constraint.at(4, _GAP, 0.9), Constraint.at(8, _GAP, 0.9)]
    system = presets.chain(12, walls)
    random = np.random.default_rng(12)
    x, v = 0.3 * _GAP * random.uniform(-1.0, 1.0, 12), random.standard_normal(12)
    problem = Problem(
        system,
        State(x, v),
        200.0,
        t=np.linspace(0.0, 200.0, 201),
        outputs=frozenset({"impacts", "energy"}),
    )
    found = time_history.solve(problem, time_history.plan(problem))
    assert found.impact_time is not None
    assert found.impact_velocity is not None
    assert found.energy is not None
    until = min(found.error_predictable_until, 30.0)
    K = system.K.to_dense()
    exact = _two_walls(K, x, v, until, 2.5e-14, 0.02)
    mine = found.impact_time[found.impact_time < until]
    timed = measure(rounds=3, ours=lambda: time_history.solve(problem, time_history.plan(problem)))
    # What impacts take: the mobility of one mass is 1.
    lost = 0.5 * (1.0 - 0.9**2) * float((found.impact_velocity**2).sum())
    balance = abs(found.energy[0] - lost - found.energy[-1]) / found.energy[0]
    rows: list[tuple[Any, ...]] = [
        (
            "Vibroimpact",
            "–",
            found.impact_time.size,
            found.error_predictable_until,
            balance,
            max(0, len(exact) - mine.size),
            _largest(mine, exact),
            timed["ours"].processor * 1e3,
        )
    ]
    for tolerance in (1e-6, 1e-9, 1e-12):
        run = partial(_two_walls, K, x, v, until, tolerance, np.inf)
        times = np.array(run())
        spent = measure(rounds=1, sample=0.0, run=run)["run"].processor * 1e3
        missed = max(0, len(exact) - times.size)
        error = _largest(times, exact)
        rows.append(("scipy DOP853", f"{tolerance:g}", None, None, None, missed, error, spent))
    return Table(
        "F: two limiters, chaotic",
        (
            "integrator",
            "tolerance",
            "impacts",
            "predictable until",
            "energy balance",
            "impacts missed",
            "error of their times",
            "time [ms]",
        ),
        rows,
        f"Ours to t = 200, compared up to t = {until:.4g}; scipy to that time only. The energy "
        "balance is what impacts take and what is left, relative to the start.",
    )


def _largest(times: Any, exact: Sequence[float]) -> float | None:
    """Return the largest difference of the times of impacts, None where some are missing."""
    if len(times) != len(exact):
        return None
    return float(np.abs(np.asarray(times) - np.asarray(exact)).max(initial=1e-17))


def _two_walls(
    K: Floats, x: Floats, v: Floats, until: float, tolerance: float, step: float
) -> list[float]:
    """Return the times of impacts of case F by scipy's DOP853 and its events."""
    n = x.size

    def rate(t: float, y: Floats) -> Floats:
        return np.concatenate([y[n:], -(K @ y[:n])])

    def wall(dof: int, side: float) -> Any:
        def room(t: float, y: Floats) -> float:
            return float(side * y[dof] - _GAP)

        room.terminal, room.direction = True, 1.0  # type: ignore[attr-defined]
        return room

    events = [wall(dof, side) for dof in (4, 8) for side in (1.0, -1.0)]
    t, y = 0.0, np.concatenate([x, v])
    times: list[float] = []
    while t < until and len(times) < 10_000:
        found = solve_ivp(
            rate,
            (t, until),
            y,
            method="DOP853",
            rtol=tolerance,
            atol=tolerance * 1e-2,
            events=events,
            max_step=step,
        )
        t, y = float(found.t[-1]), found.y[:, -1].copy()
        if found.status != 1:
            break
        times.append(t)
        which = next(k for k, hits in enumerate(found.t_events) if len(hits))
        dof = (4, 8)[which // 2]
        y[dof] = np.clip(y[dof], -_GAP, _GAP)
        y[n + dof] *= -0.9
    return times


TABLES: Final = (
    work_precision,
    against_heyoka,
    long_motions,
    stress,
    bouncing_ball,
    two_limiters,
)
