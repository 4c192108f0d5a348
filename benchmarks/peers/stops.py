"""Time histories with linear stops beside heyoka and scipy, which switch the force by events."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
import scipy.integrate

from benchmarks.harness import measure, ratio
from benchmarks.tables import Goal, Table
from vibroimpact_solvers import presets, time_history
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.laws import Linear
from vibroimpact_solvers.model import Constraint, System

# Its stubs know no functions with attributes, which is how it takes events.
_solve_ivp: Any = scipy.integrate.solve_ivp

_TIGHTEST: Final = 2.0**-52  # tolerance of heyoka
_OF_SCIPY: Final = 2.5e-14
_OUTPUTS: Final = 10
_PREPARED, _WHOLE, _CONTACTS = "prepared", "whole call", "whole call with contacts"
_GOALS: Final = {("heyoka", _PREPARED): 3.0, ("heyoka", _WHOLE): 3.0, ("DOP853", _WHOLE): 50.0}
"""Times faster than others, by the program and the way."""

Run = Callable[[], Floats]
"""Follows a motion and returns its states at the output times, shape (time, 2 dof)."""


@dataclass(frozen=True, eq=False, slots=True)
class Case:
    """A motion of unit masses, each stop on one of them."""

    name: str
    system: System
    state: Floats
    t_end: float

    @property
    def times(self) -> Floats:
        """Output times."""
        return np.linspace(self.t_end / _OUTPUTS, self.t_end, _OUTPUTS)


@dataclass(frozen=True, slots=True)
class _Side:
    dof: int
    side: float
    gap: float
    law: Linear

    @property
    def damping(self) -> float:
        assert self.law.damping is not None
        return self.law.damping


def cases() -> Iterator[Case]:
    """Yield motions that double precision can tell to their ends."""
    for damping in (0.0, 0.4):
        stop = Constraint((0,), (1.0,), 0.5, 0.5, law=Linear(400.0, damping))
        title = f"one mass, two stops, k = 400, c = {damping:g}"
        yield Case(title, presets.oscillator([stop], 1.0), np.array([0.0, 5.0]), 60.0)
    for n, dofs, t_end in ((13, (5,), 30.0), (13, (4, 8), 20.0), (50, (20,), 20.0)):
        stops = [Constraint((dof,), (1.0,), 0.2, 0.2, law=Linear(100.0, 0.3)) for dof in dofs]
        v = np.random.default_rng(3).standard_normal(n)
        title = f"chain N={n}, {2 * len(dofs)} stops, k = 100, c = 0.3"
        yield Case(title, presets.chain(n, stops), np.append(np.zeros(n), v), t_end)


def stops() -> Table:
    """Compare motions with linear stops, ten output times each."""
    return Table(
        "Time histories with linear stops",
        (
            "case", "contacts", "way", "other program", "other [ms]", "Vibroimpact [ms]",
            "times faster", "goal", "difference", "stated error",
        ),
        [row for case in cases() for row in _rows(case)],
        "Time of the processor, in turns; ratios are medians over the rounds. heyoka is compiled "
        "beforehand and at its tightest tolerance, scipy's DOP853 at 2.5e-14; events switch the "
        "force where the wall is reached and where the force is zero. Prepared motions estimate no "
        "errors, as the others do not; whole calls plan, solve and estimate all errors, and with "
        "contacts return impulse, largest force, indentation and loss of each, which the others "
        "do not. Difference: of the final states, relative to the largest; beside it what "
        "Vibroimpact states.",
        Goal("times faster", "goal", at_least=True),
        reasons={"": _WHY},
    )  # fmt: skip


_WHY: Final = (
    "with errors, five deviations are carried through each switching and its change of modes, and "
    "a whole call makes and checks problem, plan and result, objects of Python"
)


def _rows(case: Case) -> Iterator[tuple[Any, ...]]:
    n, start = case.system.n, time_history.State(*np.split(case.state, 2))

    def problem(*more: str, estimate: bool = True) -> time_history.Problem:
        outputs = frozenset({"x", "v", *more})
        return time_history.Problem(
            case.system, start, case.t_end, t=case.times, outputs=outputs, estimate=estimate
        )

    def whole(*more: str) -> time_history.Result:
        given = problem(*more)
        return time_history.solve(given, time_history.plan(given))

    bare = problem(estimate=False)
    motion = time_history.prepare(bare, time_history.plan(bare))
    ways: dict[str, Callable[[], Any]] = {
        _PREPARED: lambda: motion.solve(start),
        _WHOLE: whole,
        _CONTACTS: partial(whole, "contacts"),
    }
    others: dict[str, Run] = {"heyoka": of_heyoka(case), "DOP853": of_scipy(case)}
    both: dict[str, Any] = {**ways, **others}
    timings = measure(5, **both)
    result = whole("contacts")
    assert result.x is not None
    assert result.v is not None
    assert result.contact_start is not None
    ours = np.append(result.x[-1], result.v[-1])
    size = float(np.abs(ours).max())
    errors = np.asarray(result.error_x)[-1], np.asarray(result.error_v)[-1]
    stated = max(float(each.max()) for each in errors) / size
    for name, run in others.items():
        apart = float(np.abs(run()[-1] - ours).max()) / size
        for way in ways:
            spent = timings[name].processor * 1e3, timings[way].processor * 1e3
            times = ratio(timings[name], timings[way])
            goal = _GOALS.get((name, way))
            count = result.contact_start.size
            yield (case.name, count, way, name, *spent, times, goal, apart, stated)
    assert ours.size == 2 * n


def _sides(system: System) -> list[_Side]:
    sides = []
    for stop in system.constraints:
        assert isinstance(stop.law, Linear)
        for side, gap in ((1.0, stop.upper), (-1.0, stop.lower)):
            if gap is not None:
                sides.append(_Side(stop.dofs[0], side, gap, stop.law))
    return sides


def of_heyoka(case: Case) -> Run:
    """Return heyoka's Taylor integrator, whose own events switch forces by parameters."""
    import heyoka as hy

    n, K, sides = case.system.n, case.system.K.to_dense(), _sides(case.system)
    variables = list(hy.make_vars(*[f"{kind}{i}" for kind in "xv" for i in range(n)]))
    x, v = variables[:n], variables[n:]
    push: list[list[Any]] = [[] for _ in range(n)]
    events = []

    def switch(place: int, to: float) -> Callable[[Any, int], bool]:
        def callback(integrator: Any, sign: int) -> bool:
            integrator.pars[place] = to
            return True

        return callback

    up, down = hy.event_direction.positive, hy.event_direction.negative
    for place, one in enumerate(sides):
        beyond = one.side * x[one.dof] - one.gap
        force = one.law.stiffness * beyond + one.damping * one.side * v[one.dof]
        push[one.dof].append(-one.side * hy.par[place] * force)
        events.append(hy.t_event(beyond, callback=switch(place, 1.0), direction=up))
        events.append(hy.t_event(force, callback=switch(place, 0.0), direction=down))
    rates = [(x[i], v[i]) for i in range(n)]
    for i in range(n):
        rates.append((v[i], hy.sum([-K[i, j] * x[j] for j in np.flatnonzero(K[i])] + push[i])))
    integrator = hy.taylor_adaptive(
        rates, state=case.state.copy(), t_events=events, tol=_TIGHTEST, compact_mode=n > 20,
        pars=np.zeros(len(sides)),
    )  # fmt: skip
    grid = np.append(0.0, case.times)

    def run() -> Floats:
        integrator.time = 0.0
        integrator.state[:], integrator.pars[:] = case.state, 0.0
        integrator.reset_cooldowns()
        return np.array(integrator.propagate_grid(grid)[-1][1:])

    return run


def of_scipy(case: Case) -> Run:
    """Return scipy's DOP853, started again at each event."""
    n, K, sides = case.system.n, case.system.K.to_dense(), _sides(case.system)
    grid = case.times

    def beyond(one: _Side, y: Floats) -> float:
        return float(one.side * y[one.dof] - one.gap)

    def force(one: _Side, y: Floats) -> float:
        return one.law.stiffness * beyond(one, y) + one.damping * one.side * float(y[n + one.dof])

    def event(one: _Side, of: Callable[[_Side, Floats], float], direction: float) -> Any:
        def zero(t: float, y: Floats) -> float:
            return of(one, y)

        zero.terminal, zero.direction = True, direction  # type: ignore[attr-defined]
        return zero

    def run() -> Floats:
        t, y, loaded = 0.0, case.state.copy(), [False] * len(sides)
        states = np.empty((0, 2 * n))
        while t < case.t_end:

            def rate(t: float, y: Floats) -> Floats:
                a = -(K @ y[:n])
                for one, on in zip(sides, loaded, strict=True):
                    if on:
                        a[one.dof] -= one.side * force(one, y)
                return np.concatenate([y[n:], a])

            events = [
                event(one, force, -1.0) if on else event(one, beyond, 1.0)
                for one, on in zip(sides, loaded, strict=True)
            ]
            solution = _solve_ivp(
                rate, (t, case.t_end), y, method="DOP853", rtol=_OF_SCIPY, atol=1e-2 * _OF_SCIPY,
                events=events, t_eval=grid[grid > t],
            )  # fmt: skip
            states = np.concatenate([states, np.reshape(solution.y, (2 * n, -1)).T])
            if solution.status != 1:
                break
            which = next(i for i, times in enumerate(solution.t_events) if times.size)
            t, y = float(solution.t_events[which][0]), solution.y_events[which][0]
            loaded[which] = not loaded[which]
        return states

    return run
