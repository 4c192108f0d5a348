"""Other integrators, each as its manual advises, at a whole ladder of tolerances.

All find impacts by the event detection they bring along and go on with the reversed velocity.
heyoka does so inside its own loop, by the callback of a terminal event, and Siconos knows impacts
by itself; the others stop at an impact and are started again. Where impacts are missed,
those that can are run once more with steps that are short enough for the motion.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import scipy.integrate

from benchmarks.harness import measure, versions
from benchmarks.peers import siconos
from benchmarks.peers.scene import Outcome, Scene, acceleration
from vibroimpact_solvers.arrays import Floats

# Its stubs know no functions with attributes, which is how it takes events.
solve_ivp: Any = scipy.integrate.solve_ivp

Solver = Callable[[Scene, float], Outcome]
"""Follows a motion of the structure that it was made for, to a tolerance."""
Advance = Callable[[float, Floats], tuple[float, Floats, bool]]

LADDER: Final = (1e-3, 1e-6, 1e-9, 1e-12)
TIGHTEST: Final = 2.5e-14
"""Of scipy, and what the tightest of the others are near to."""
SLOW: Final = 0.05
"""Seconds from which a run is timed twice only, and the less taken."""


@dataclass(frozen=True, slots=True)
class Point:
    """A run of an integrator: its setting, its outcome, and seconds of the processor.

    ``preparing`` is what its first run took beyond another: making and compiling. ``again``
    repeats the run, where that is possible in this process.
    """

    setting: str
    outcome: Outcome
    seconds: float
    preparing: float = 0.0
    again: Callable[[], Outcome] | None = None


def scipy_events(method: str) -> Callable[[Scene], Solver]:
    """Return scipy's `solve_ivp`, with dense output between its steps as it does events."""

    def prepare(scene: Scene) -> Solver:
        n, x = scene.n, acceleration(scene)

        def rate(t: float, y: Floats) -> Floats:
            return np.concatenate([y[n:], x(t, y)])

        walls = [] if scene.limiter else [_event(wall.room) for wall in scene.walls]

        def solve(again: Scene, tolerance: float) -> Outcome:
            def advance(t: float, y: Floats) -> tuple[float, Floats, bool]:
                solution = solve_ivp(
                    rate,
                    (t, again.t_end),
                    y,
                    method=method,
                    rtol=tolerance,
                    atol=tolerance * 1e-2,
                    events=walls,
                    max_step=again.step,
                )
                return float(solution.t[-1]), solution.y[:, -1].copy(), solution.status == 1

            return restarted(again, advance)

        return solve

    return prepare


def _event(room: Callable[[Floats], float]) -> Any:
    def event(t: float, y: Floats) -> float:
        return room(y)

    event.terminal, event.direction = True, 1.0  # type: ignore[attr-defined]
    return event


def cvode_events(scene: Scene) -> Solver:
    """Return CVODE of SUNDIALS, Adams, with its root finding."""
    from sksundae.cvode import CVODE

    n, x, walls = scene.n, acceleration(scene), () if scene.limiter else scene.walls

    def rate(t: float, y: Floats, yp: Floats) -> None:
        yp[:n] = y[n:]
        yp[n:] = x(t, y)

    def room(t: float, y: Floats, events: Floats) -> None:
        for i, wall in enumerate(walls):
            events[i] = wall.room(y)

    room.terminal = [True] * len(walls)  # type: ignore[attr-defined]
    room.direction = [1] * len(walls)  # type: ignore[attr-defined]
    events = {"eventsfn": room, "num_events": len(walls)} if walls else {}
    # A full Jacobian by differences is not for large structures.
    linear = {"linsolver": "gmres", "krylov_dim": 5} if n > 50 else {}

    def solve(again: Scene, tolerance: float) -> Outcome:
        solver = CVODE(
            rate,
            method="Adams",
            rtol=max(tolerance, 1e-14),
            atol=max(tolerance, 1e-14) * 1e-2,
            max_num_steps=100_000,
            max_step=0.0 if math.isinf(again.step) else again.step,
            **events,
            **linear,
        )

        def advance(t: float, y: Floats) -> tuple[float, Floats, bool]:
            solution = solver.solve(np.array([t, again.t_end]), y)
            return float(solution.t[-1]), np.array(solution.y[-1]), solution.status == 2

        return restarted(again, advance)

    return solve


def restarted(scene: Scene, advance: Advance) -> Outcome:
    """Follow a motion from impact to impact with an integrator that stops at each."""
    t, y = 0.0, scene.state.copy()
    times: list[float] = []
    while t < scene.t_end:
        try:
            now, y, struck = advance(t, y)
        except (ValueError, RuntimeError, ArithmeticError) as error:
            return Outcome(tuple(times), y, f"throws {type(error).__name__}")
        if not struck:
            return Outcome(tuple(times), y)
        wall = max(scene.walls, key=lambda wall: wall.room(y))
        # Root finders end on either side of the wall; beyond it the next search would miss.
        y[wall.dof] = wall.side * wall.gap
        y[scene.n + wall.dof] *= -wall.restitution
        if now <= t or len(times) >= scene.most:
            return Outcome(tuple(times), y, "stalls")
        t = now
        times.append(t)
    return Outcome(tuple(times), y)


def heyoka_events(scene: Scene, times: Floats | None = None) -> Solver:
    """Return heyoka's Taylor integrator with its own events; compiled for each tolerance.

    Its state at given times, the end last, comes from its dense output.
    """
    import heyoka as hy

    n, K, C, force = scene.n, scene.stiffness, scene.damping, scene.system.force
    names = [f"{kind}{i}" for kind in "xv" for i in range(n)]
    variables = list(hy.make_vars(*names))
    x, v = variables[:n], variables[n:]
    push: list[list[Any]] = [[] for _ in range(n)]
    for one in scene.load:
        turn = hy.cos(one.frequency * hy.time + one.phase)
        push[one.dof].append(one.amplitude * turn)
    law = scene.limiter
    for limiter in scene.system.constraints if law else ():
        # An odd power of equal gaps needs no cases; products of series know no division by zero.
        assert law is not None
        assert limiter.symmetric
        assert law.exponent % 2 == 1
        dof, size = limiter.dofs[0], law.scale * float(limiter.upper or 0.0)
        push[dof].append(-law.stiffness * _power(x[dof] / size, int(law.exponent)))
    rates = [(x[i], v[i]) for i in range(n)]
    for i in range(n):
        terms = [-K[i, j] * x[j] for j in np.flatnonzero(K[i])] + push[i]
        terms += [] if C is None else [-C[i, j] * v[j] for j in np.flatnonzero(C[i])]
        terms += [hy.expression(0.0 if force is None else float(force[i]))]
        rates.append((v[i], hy.sum(terms)))
    struck: list[float] = []

    def event(wall: Any) -> Any:
        def impact(integrator: Any, sign: int) -> bool:
            struck.append(integrator.time)
            integrator.state[n + wall.dof] *= -wall.restitution
            return len(struck) < scene.most

        room = wall.side * x[wall.dof] - wall.gap
        return hy.t_event(room, callback=impact, direction=hy.event_direction.positive)

    events = [] if law else [event(wall) for wall in scene.walls]
    made: dict[float, Any] = {}

    def solve(again: Scene, tolerance: float) -> Outcome:
        if tolerance not in made:
            made[tolerance] = hy.taylor_adaptive(
                rates, state=again.state, t_events=events, tol=tolerance, compact_mode=n > 20
            )
        integrator = made[tolerance]
        struck.clear()
        integrator.time = 0.0
        integrator.state[:] = again.state
        if events:
            integrator.reset_cooldowns()
        limit = {} if math.isinf(again.step) else {"max_delta_t": again.step}
        if times is None:
            integrator.propagate_until(again.t_end, **limit)
        else:
            integrator.propagate_grid(np.append(0.0, times), **limit)
        end = "stalls" if len(struck) >= again.most else ""
        return Outcome(tuple(struck), np.array(integrator.state), end)

    return solve


def _power(base: Any, exponent: int) -> Any:
    """Return a whole power by repeated squaring."""
    if exponent == 1:
        return base
    half = _power(base, exponent // 2)
    return half * half * base if exponent % 2 else half * half


def diffrax_events(scene: Scene) -> Solver:
    """Return diffrax, Dopri8 with PID steps and Newton's method at events, compiled."""
    import diffrax
    import jax
    import jax.numpy as jnp
    import optimistix

    config: Any = jax.config
    config.update("jax_enable_x64", True)
    n, K, force = scene.n, jnp.array(scene.stiffness), scene.system.force
    C = None if scene.damping is None else jnp.array(scene.damping)
    walls, law = scene.walls, scene.limiter

    def rate(t: Any, y: Any, args: Any) -> Any:
        v_rate = -(K @ y[:n])
        if C is not None:
            v_rate -= C @ y[n:]
        if force is not None:
            v_rate += jnp.array(force)
        for one in scene.load:
            turn = jnp.cos(one.frequency * t + one.phase)
            v_rate = v_rate.at[one.dof].add(one.amplitude * turn)
        for wall in walls if law else ():
            assert law is not None
            depth = jnp.maximum(wall.side * y[wall.dof] / (law.scale * wall.gap), 0.0)
            push = wall.side * law.stiffness * depth**law.exponent
            v_rate = v_rate.at[wall.dof].add(-push)
        return jnp.concatenate([y[n:], v_rate])

    def room(wall: Any) -> Any:
        return lambda t, y, args, **_: wall.side * y[wall.dof] - wall.gap

    compiled: Callable[[Any], Any] = jax.jit

    @compiled
    def fly(t: Any, t_end: Any, y: Any, tolerance: Any, step: Any) -> Any:
        newton: Any = optimistix.Newton(tolerance, tolerance)
        rooms = [room(wall) for wall in walls]
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(rate),
            diffrax.Dopri8(),
            t,
            t_end,
            None,
            y,
            stepsize_controller=diffrax.PIDController(
                rtol=tolerance, atol=tolerance * 1e-2, dtmax=step
            ),
            event=None if law else diffrax.Event(rooms, newton, [True] * len(rooms)),
            max_steps=100_000,
            throw=False,
        )
        assert solution.ts is not None
        return solution.ts[-1], solution.ys[-1], diffrax.is_event(solution.result)

    def solve(again: Scene, tolerance: float) -> Outcome:
        def advance(t: float, y: Floats) -> tuple[float, Floats, bool]:
            end, state, struck = fly(t, again.t_end, y, tolerance, again.step)
            return float(end), np.array(state), bool(struck)

        return restarted(again, advance)

    return solve


@dataclass(frozen=True, slots=True)
class Peer:
    """An integrator in this process: what it needs, what prepares it, and its tolerances."""

    package: str
    prepare: Callable[[Scene], Solver]
    tolerances: Sequence[float]


PEERS: Final[dict[str, Peer]] = {
    "heyoka": Peer("heyoka", heyoka_events, (*LADDER, 2.0**-52)),
    "scipy DOP853": Peer("scipy", scipy_events("DOP853"), (*LADDER, TIGHTEST)),
    "scipy LSODA": Peer("scipy", scipy_events("LSODA"), (*LADDER, TIGHTEST)),
    "CVODE": Peer("scikit-sundae", cvode_events, (*LADDER, 1e-14)),
    "diffrax Dopri8": Peer("diffrax", diffrax_events, (*LADDER, 1e-14)),
}
"""Integrators that run in this process, by name."""


def installed() -> list[str]:
    """Return the integrators whose packages are there."""
    names = [name for name, peer in PEERS.items() if versions(peer.package)]
    return names + (list(siconos.VARIANTS) if siconos.version() else [])


def settings() -> str:
    """Return versions of the peers, and how they are set, for a note."""
    packages = sorted({peer.package for peer in PEERS.values()})
    there = [f"{name} {number}" for name, number in versions(*packages).items()]
    there += [f"Siconos {number}" for number in [siconos.version()] if number]
    missing = [name for name in PEERS if name not in installed()]
    missing += [] if siconos.version() else ["Siconos"]
    if missing:
        there.append(f"not installed: {', '.join(missing)}")
    return f"{', '.join(there)}. {siconos.SETTINGS if siconos.version() else ''}".strip()


def ladder(
    name: str,
    scene: Scene,
    missed: Callable[[Outcome], int],
    step: float = math.inf,
    cap: float = math.inf,
) -> Iterator[Point]:
    """Yield runs of an integrator from loose to tight, until one takes longer than the cap.

    Parameters
    ----------
    name : str
        One of those `installed`.
    scene : Scene
    missed : callable
        Counts the impacts that an outcome lacks.
    step : float
        With steps of this length the run is made again where impacts are missing.
    cap : float
        Seconds of the processor.
    """
    if name in siconos.VARIANTS:
        for label, outcome, seconds in siconos.runs(name, scene, cap):
            yield Point(label, outcome, seconds)
        return
    peer, short = PEERS[name], replace(scene, step=step)
    solve = peer.prepare(scene)
    for tolerance in peer.tolerances:
        point = _run(solve, scene, tolerance, f"{tolerance:.2g}")
        yield point
        if point.seconds < cap and missed(point.outcome) and not math.isinf(step):
            point = _run(solve, short, tolerance, f"{tolerance:.2g}, steps ≤ {step:.2g}")
            yield point
        if point.seconds >= cap:
            return


def _run(solve: Solver, scene: Scene, tolerance: float, label: str) -> Point:
    return timed(lambda: solve(scene, tolerance), label)


def timed(run: Callable[[], Outcome], label: str) -> Point:
    """Return a run with its time."""
    start = time.process_time()
    outcome = run()
    first = time.process_time() - start
    start = time.process_time()
    run()
    once = time.process_time() - start
    if once < SLOW:
        once = measure(3, sample=0.005, run=run)["run"].processor
    once = min(first, once)
    return Point(label, outcome, once, first - once, run)
