"""An oscillator between lossy walls, eq. 10.90-10.123: exact, slow flows and their limits.

Between the impacts nothing is lost, so the interval n between two impacts has the speed ``u k^n``
at both walls and the frequency ratio ``tan(lambda_n) = Omega Delta / (u k^n)``. With
kappa = -ln(k) the slow flow

    tan(lambda) = tan(lambda0) exp(kappa phi/2),
    dlambda/dt = kappa Omega sin(2 lambda) / (4 lambda)

has these values at every even phase phi = 2n, and at impacts, phi = 2n - 1, the geometric mean
of both sides. Its time replaces the sum over the intervals by an integral; the next term of the
Euler-Maclaurin formula makes it exact to the second order in kappa, uniformly in time.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Final, NamedTuple, Self

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels import arctangent, lossy_walls
from vibroimpact_solvers.kernels.threads import over_ranges
from vibroimpact_solvers.model import System
from vibroimpact_solvers.slow_flow import parameters, printed_clock
from vibroimpact_solvers.slow_flow.limits import grazing, high_energy
from vibroimpact_solvers.slow_flow.lossy_motion import LossyMotion
from vibroimpact_solvers.slow_flow.motion import Impacts, Initial, Model, Motion, Variant

_STEPS: Final = 100.0  # elementary steps that one time takes

_WITHOUT_SPRING: Final = ("exact", "high_energy", "high_energy_printed")


class _State(NamedTuple):
    """State and displacement of a variant: gamma, omega, phi, x and v, each shape (time,)."""

    gamma: Floats
    omega: Floats
    phi: Floats
    x: Floats | None
    v: Floats | None


@dataclass(frozen=True)
class Restitution(Model):
    """The oscillator of eq. 10.90 and 10.95."""

    # Mass, natural frequency, distance of the walls and restitution
    mass: float
    Omega: float
    Delta: float
    k: float
    exact_motion: LossyMotion  # the exact motion, upwards at first
    side: float = 1.0  # 1 where the first impact is at the upper wall, -1 at the lower one
    shift: float = 0.0  # time at which the slow flows have phi = 0 and lambda = lambda0

    VARIANTS: ClassVar[Mapping[str, Variant]] = {
        "exact": Variant("exact between impacts", "speeds and times of all impacts in closed form"),
        "corrected": Variant(
            "inverse tangent integral", "the slow flow of the energy balance, in closed form"
        ),
        "second_order": Variant(
            "inverse tangent integral", "the slow flow whose clock is exact to the second order"
        ),
        "printed": Variant("quadrature", "eq. 10.113-10.116 as printed: right for small lambda"),
        "high_energy": Variant("elementary", "the limit lambda -> 0, eq. 10.117-10.120 with kappa"),
        "high_energy_printed": Variant("elementary", "the limit lambda -> 0, eq. 10.117-10.120"),
        "grazing": Variant("elementary", "the limit lambda -> pi/2, which is exponential"),
        "grazing_printed": Variant("elementary", "eq. 10.121-10.123 as printed: algebraic"),
    }
    INITIAL: ClassVar[tuple[str, ...]] = ("omega", "gamma", "x", "v")

    @classmethod
    def of(cls, system: System, initial: Initial, variant: str, until: float) -> Self:
        """Take the parameters from an oscillator with a lossy limiter, and omega or x and v."""
        one = parameters.single(system)
        Delta, k = parameters.distance(one.limiter), one.limiter.restitution
        where = ("system", "constraints", 0, "restitution")
        if not 0.0 < k < 1.0 and variant != "exact":
            raise parameters.refuse(where, "slow flows need a restitution between 0 and 1")
        if one.Omega == 0.0 and variant not in _WITHOUT_SPRING:
            raise parameters.refuse(("system", "K"), "this variant needs a spring")
        if initial.x is None and initial.v is None:
            return cls(one.mass, one.Omega, Delta, k, _from_frequency(initial, one.Omega, Delta, k))
        if initial.omega is not None or initial.gamma is not None:
            raise parameters.outside("x", "give either x and v, or omega, or gamma")
        x, v = parameters.given(initial, "x"), parameters.given(initial, "v")
        if abs(x) > Delta:
            raise parameters.outside("x", "the motion starts beyond a wall")
        side = -1.0 if v < 0.0 else 1.0
        exact_motion = LossyMotion.from_state(one.Omega, Delta, k, side * x, side * v)
        if exact_motion is None:
            raise parameters.outside("v", "the motion reaches no wall")
        model = cls(one.mass, one.Omega, Delta, k, exact_motion, side)
        # The slow flows meet the exact motion at its first impact, phi = 1.
        if variant == "exact":
            return model
        return replace(model, shift=exact_motion.first - model._clock_at_one(variant))

    @property
    def kappa(self) -> float:
        """Decay of the speed in one impact, -ln k."""
        return -math.log(self.k)

    @property
    def eps(self) -> float:
        """Loss of speed in one impact, 1 - k (eq. 10.91)."""
        return 1.0 - self.k

    @property
    def z0(self) -> float:
        """tan(lambda0): lambda0 belongs to the speed before the first impact."""
        return self.Omega * self.Delta / self.exact_motion.speed

    def expected_impacts(self, until: float) -> float:
        """Return a bound on the number of impacts."""
        return self.exact_motion.expected(until)

    def impacts(self, until: float) -> Impacts:
        """Return the impacts of the exact motion; gamma by the mean energy at the impact."""
        time = self.exact_motion.times(until)
        n = np.arange(1.0, time.size + 1.0)
        speed = self.exact_motion.speeds(n - 1.0)
        gamma = np.arctan2(self.Omega * self.Delta, math.sqrt(self.k) * speed)
        return Impacts(time, speed, 2.0 * n - 1.0 + self._turn, gamma)

    def motion(self, variant: str, t: Floats, *, shapes: bool = True) -> Motion:
        """Return the motion at some times."""
        state = self._state(variant, t, shapes)
        stage: Integers = np.zeros(t.size, dtype=np.int64)
        x = None if state.x is None else self.side * state.x[:, None]
        v = None if state.v is None else self.side * state.v[:, None]
        phi = state.phi + self._turn
        return Motion(stage, phi, state.gamma, state.omega, x=x, v=v)

    def impulse(self, motion: Motion) -> Floats:
        """Return p = m omega^2 gamma Delta / tan(gamma), eq. 10.109, finite without a spring."""
        assert motion.gamma is not None
        assert motion.omega is not None
        sine = np.sinc(motion.gamma / np.pi)
        return self.mass * self.Delta * motion.omega**2 * np.cos(motion.gamma) / sine

    @property
    def _turn(self) -> float:
        return 0.0 if self.side > 0 else 2.0

    def _state(self, variant: str, t: Floats, shapes: bool) -> _State:
        later = t - self.shift
        omega0 = self.exact_motion.speed / self.Delta
        match variant:
            case "exact":
                return _State(*self.exact_motion.at(t))
            case "corrected" | "second_order":
                return self._corrected(later, variant == "second_order", shapes)
            case "printed":
                return self._printed(later, shapes)
            case "high_energy" | "high_energy_printed":
                rate = self.kappa if variant == "high_energy" else self.eps
                omega, phi, x, v = high_energy(later, rate, omega0, self.Delta)
                return _State(self.Omega / omega, omega, phi, x, v)
            case _:
                lam0 = math.atan(self.z0)
                rate = self.kappa if variant == "grazing" else self.eps
                printed = variant == "grazing_printed"
                lam, phi = grazing(self.Omega * later, rate, lam0, printed=printed)
                x = self.Delta * np.sin(0.5 * np.pi * phi)
                v = self.Omega * self.Delta * np.cos(0.5 * np.pi * phi)
                return _State(lam, self.Omega / lam, phi, x, v)

    def _corrected(self, later: Floats, second: bool, shapes: bool) -> _State:
        lam, phi = np.empty((2, later.size))
        x, v = np.empty((2, later.size if shapes else 0))
        y0 = float(arctangent.inverse_tangent_integral(np.array(self.z0)))
        rows, w0 = arctangent.table(), math.log(self.z0)
        clock = lossy_walls.Clock(rows, y0, w0, self.kappa, second)
        times, into = self.Omega * later, lossy_walls.SlowFlow(lam, phi, x, v)

        def piece(start: int, stop: int) -> None:
            part = lossy_walls.SlowFlow(*(array[start:stop] for array in into))
            lossy_walls.slow_flow(times[start:stop], clock, part)

        over_ranges(piece, later.size, _STEPS * later.size * (4.0 if second else 1.0))
        return self._scaled(lam, phi, *((x, v) if shapes else (None, None)))

    def _printed(self, later: Floats, shapes: bool) -> _State:
        lam0, eps = np.array(math.atan(self.z0)), self.eps
        lam = printed_clock.ratio(printed_clock.clock(lam0) + eps * self.Omega * later)
        phi = (printed_clock.phase(lam) - printed_clock.phase(lam0)) / eps
        if not shapes:
            return self._scaled(lam, phi, None, None)
        x, v = np.empty_like(lam), np.empty_like(lam)
        lossy_walls.printed_shapes(lam, phi, eps, x, v)
        return self._scaled(lam, phi, x, v)

    def _scaled(self, lam: Floats, phi: Floats, x: Floats | None, v: Floats | None) -> _State:
        if x is not None and v is not None:
            x, v = self.Delta * x, self.Omega * self.Delta * v
        return _State(lam, self.Omega / lam, phi, x, v)

    def _clock_at_one(self, variant: str) -> float:
        """Return the time from phi = 0 to phi = 1 in a slow flow."""
        low, high = 0.0, 4.0 * self.Delta / self.exact_motion.speed
        if self.Omega > 0.0:
            high = min(high, math.pi / self.Omega)
        # The phase grows with time; halving it is exact to the last bit soon enough.
        for _ in range(200):
            middle = 0.5 * (low + high)
            if middle in {low, high}:
                break
            early = self._state(variant, np.array([middle]), False).phi[0] < 1.0
            low, high = (middle, high) if early else (low, middle)
        return 0.5 * (low + high)


def _from_frequency(initial: Initial, Omega: float, Delta: float, k: float) -> LossyMotion:
    """Return the motion that begins midway between two impacts, as eq. 10.116 has it at t = 0."""
    if initial.gamma is not None:
        if Omega == 0.0 or initial.omega is not None:
            raise parameters.outside("gamma", "give either omega or gamma, which needs a spring")
        gamma = initial.gamma
    else:
        omega = parameters.given(initial, "omega")
        if omega <= 0.0:
            raise parameters.outside("omega", "omega is positive")
        gamma = Omega / omega
    if not 0.0 <= gamma < 0.5 * math.pi or (Omega > 0.0 and gamma == 0.0):
        raise parameters.outside(
            "omega" if initial.gamma is None else "gamma",
            "impacts need a frequency above the natural one: 0 < gamma < pi/2",
        )
    if Omega == 0.0:
        speed = parameters.given(initial, "omega") * Delta
    else:
        speed = Omega * Delta / math.tan(gamma)
    x = 0.25 * math.log(k) * Delta * math.cos(gamma) if k > 0.0 else 0.0
    if abs(x) >= Delta:
        message = f"with a restitution of {k!r} the motion would start at {x!r}, beyond a wall"
        raise parameters.outside("omega" if initial.gamma is None else "gamma", message)
    v = math.sqrt(speed**2 + Omega**2 * (Delta - x) * (Delta + x))
    exact_motion = LossyMotion.from_state(Omega, Delta, k, x, v)
    if exact_motion is None:
        message = "the motion grazes the walls: rounding decides whether it reaches them"
        raise parameters.outside("omega" if initial.gamma is None else "gamma", message)
    return LossyMotion(Omega, Delta, k, speed, exact_motion.first)
