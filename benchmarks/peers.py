"""Other integrators on structures with one limiter ``|x_a| <= gap``, each as its manual advises.

All get ``x'' = -A x``, find impacts by the event detection they bring along and go on with the
reversed velocity. heyoka does so inside its own loop, by the callback of a terminal event; the
others stop at an impact and are started again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import scipy.integrate

from benchmarks.harness import versions
from vibroimpact_solvers.arrays import Floats

# Its stubs know no functions with attributes, which is how it takes events.
solve_ivp: Any = scipy.integrate.solve_ivp


@dataclass(frozen=True, slots=True)
class Scene:
    """A motion with impacts.

    Parameters
    ----------
    A : array, shape (dof, dof)
        ``M^-1 K``.
    dof : int
        The limited one.
    gap, restitution : float
    state : array, shape (2 dof,)
        Displacements and velocities at t = 0.
    t_end : float
    """

    A: Floats
    dof: int
    gap: float
    restitution: float
    state: Floats
    t_end: float

    @property
    def n(self) -> int:
        """Degrees of freedom."""
        return len(self.A)


@dataclass(frozen=True, slots=True)
class Outcome:
    """Impacts and final state that an integrator found."""

    times: tuple[float, ...]
    state: Floats


Integrator = Callable[[Scene], Outcome]
Flight = Callable[[float, Floats], tuple[float, Floats, bool]]


def scipy_flights(method: str, tolerance: float) -> Callable[[Scene], Integrator]:
    """Return scipy's `solve_ivp`, with dense output between its steps as it does events."""

    def prepare(scene: Scene) -> Integrator:
        n, a, A = scene.n, scene.dof, scene.A

        def rate(t: float, y: Floats) -> Floats:
            return np.concatenate([y[n:], -(A @ y[:n])])

        def wall(side: float) -> Any:
            def room(t: float, y: Floats) -> float:
                return float(side * y[a] - scene.gap)

            room.terminal, room.direction = True, 1.0  # type: ignore[attr-defined]
            return room

        events = [wall(1.0), wall(-1.0)]

        def flight(t: float, y: Floats) -> tuple[float, Floats, bool]:
            found = solve_ivp(
                rate,
                (t, scene.t_end),
                y,
                method=method,
                rtol=tolerance,
                atol=tolerance * 1e-2,
                events=events,
            )
            return float(found.t[-1]), found.y[:, -1].copy(), found.status == 1

        return lambda again: restarted(again, flight)

    return prepare


def cvode_flights(tolerance: float) -> Callable[[Scene], Integrator]:
    """Return CVODE of SUNDIALS, Adams, with its root finding."""

    def prepare(scene: Scene) -> Integrator:
        from sksundae.cvode import CVODE

        n, a, A = scene.n, scene.dof, scene.A

        def rate(t: float, y: Floats, yp: Floats) -> None:
            yp[:n] = y[n:]
            yp[n:] = -(A @ y[:n])

        def room(t: float, y: Floats, events: Floats) -> None:
            events[0], events[1] = y[a] - scene.gap, -y[a] - scene.gap

        room.terminal = [True, True]  # type: ignore[attr-defined]
        room.direction = [1, 1]  # type: ignore[attr-defined]
        solver = CVODE(
            rate,
            method="Adams",
            rtol=max(tolerance, 1e-14),
            atol=max(tolerance, 1e-14) * 1e-2,
            eventsfn=room,
            num_events=2,
            max_num_steps=100_000,
        )

        def flight(t: float, y: Floats) -> tuple[float, Floats, bool]:
            found = solver.solve(np.array([t, scene.t_end]), y)
            return float(found.t[-1]), np.array(found.y[-1]), found.status == 2

        return lambda again: restarted(again, flight)

    return prepare


def restarted(scene: Scene, flight: Flight) -> Outcome:
    """Follow a motion from impact to impact with an integrator that stops at each."""
    t, y = 0.0, scene.state.copy()
    times: list[float] = []
    while t < scene.t_end and len(times) < 100_000:
        t, y, struck = flight(t, y)
        if not struck:
            break
        times.append(t)
        # Root finders end on either side of the wall; beyond it the next search would miss.
        y[scene.dof] = np.clip(y[scene.dof], -scene.gap, scene.gap)
        y[scene.n + scene.dof] *= -scene.restitution
    return Outcome(tuple(times), y)


def heyoka_events(tolerance: float) -> Callable[[Scene], Integrator]:
    """Return heyoka's Taylor integrator; made and compiled beforehand, its own events."""

    def prepare(scene: Scene) -> Integrator:
        import heyoka as hy

        n, a = scene.n, scene.dof
        x = hy.make_vars(*[f"x{i}" for i in range(n)])
        v = hy.make_vars(*[f"v{i}" for i in range(n)])
        x, v = (list(x), list(v)) if n > 1 else ([x], [v])
        rates = [(x[i], v[i]) for i in range(n)]
        for i in range(n):
            terms = [-scene.A[i, j] * x[j] for j in range(n) if scene.A[i, j]]
            rates.append((v[i], hy.sum(terms)))
        times: list[float] = []

        def impact(integrator: Any, sign: int) -> bool:
            times.append(integrator.time)
            integrator.state[n + a] *= -scene.restitution
            return True

        events = [
            hy.t_event(
                side * x[a] - scene.gap, callback=impact, direction=hy.event_direction.positive
            )
            for side in (1.0, -1.0)
        ]
        integrator = hy.taylor_adaptive(
            rates, state=scene.state, t_events=events, tol=tolerance, compact_mode=n > 20
        )

        def run(again: Scene) -> Outcome:
            times.clear()
            integrator.time = 0.0
            integrator.state[:] = again.state
            integrator.reset_cooldowns()
            integrator.propagate_until(again.t_end)
            return Outcome(tuple(times), np.array(integrator.state))

        return run

    return prepare


def diffrax_flights(tolerance: float) -> Callable[[Scene], Integrator]:
    """Return diffrax, Dopri8 with PID steps and Newton's method at events, compiled."""

    def prepare(scene: Scene) -> Integrator:
        import diffrax
        import jax
        import jax.numpy as jnp
        import optimistix

        config: Any = jax.config
        config.update("jax_enable_x64", True)
        n, a, gap, t_end = scene.n, scene.dof, scene.gap, scene.t_end
        A = jnp.array(scene.A)
        term = diffrax.ODETerm(lambda t, y, args: jnp.concatenate([y[n:], -(A @ y[:n])]))
        newton: Any = optimistix.Newton(tolerance, tolerance)
        event = diffrax.Event(
            [lambda t, y, args, **_: y[a] - gap, lambda t, y, args, **_: -y[a] - gap],
            newton,
            [True, True],
        )

        compiled: Callable[[Any], Any] = jax.jit

        @compiled
        def solve(t: Any, y: Any) -> Any:
            found = diffrax.diffeqsolve(
                term,
                diffrax.Dopri8(),
                t,
                t_end,
                None,
                y,
                stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=tolerance * 1e-2),
                event=event,
                max_steps=100_000,
                throw=False,
            )
            struck = diffrax.is_event(found.result)
            return found.ts[-1], found.ys[-1], struck

        def flight(t: float, y: Floats) -> tuple[float, Floats, bool]:
            end, state, struck = solve(t, y)
            return float(end), np.array(state), bool(struck)

        return lambda again: restarted(again, flight)

    return prepare


PEERS: Final[dict[str, tuple[str, Callable[[float], Callable[[Scene], Integrator]]]]] = {
    "heyoka": ("heyoka", heyoka_events),
    "scipy DOP853": ("scipy", lambda tolerance: scipy_flights("DOP853", tolerance)),
    "scipy LSODA": ("scipy", lambda tolerance: scipy_flights("LSODA", tolerance)),
    "CVODE": ("scikit-sundae", cvode_flights),
    "diffrax Dopri8": ("diffrax", diffrax_flights),
}
"""Peers by name: the package each needs, and what prepares it for a tolerance and a scene."""


def installed() -> list[str]:
    """Return the peers whose packages are there."""
    return [name for name, (package, _) in PEERS.items() if versions(package)]


def settings() -> str:
    """Return versions of the peers, for a note."""
    packages = sorted({PEERS[name][0] for name in installed()})
    there = ", ".join(f"{name} {number}" for name, number in versions(*packages).items())
    missing = [name for name in PEERS if name not in installed()]
    return there + (f"; not installed: {', '.join(missing)}" if missing else "")
