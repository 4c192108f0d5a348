"""Response spectra of motions: the largest responses of oscillators on one coordinate."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from vibroimpact import grids
from vibroimpact.arguments import integer, number
from vibroimpact.motion_plots import column_of, constraints_of
from vibroimpact.oscillators import Jumps, Pieces, largest
from vibroimpact.results import Result
from vibroimpact.style import ADMISSIBLE, OTHER, legend, new_axes, note
from vibroimpact.tables import Array, Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike, NDArray

    Floats = NDArray[np.float64]

_PER_PERIOD: Final = 8
"""Output times in a period of the fastest oscillator: half of them, with which errors are
estimated, still give the amplitude of a motion of that period to 1 %."""
_DECADE: Final = 10.0
"""Ratio of frequencies from which their axis is logarithmic."""


class Motion(Result):
    """A motion over time, on which oscillators can ride."""

    def response_spectrum(
        self,
        dof: int | None = None,
        frequencies: ArrayLike | tuple[float, float, int] | Mapping[str, Any] = (0.5, 50.0, 100),
        damping: float = 0.05,
        unit: Literal["Hz", "rpm", "Omega", "omega"] = "Hz",
    ) -> ResponseSpectrum:
        """Return the largest responses of oscillators that ride on one coordinate.

        It is the floor response spectrum of equipment that does not act back on the structure.
        The absolute displacement w of an oscillator of angular frequency Ω and damping ratio ζ on
        a coordinate with the absolute displacement x obeys

            w'' + 2 ζ Ω (w' - x') + Ω² (w - x) = 0

        It starts at the first output time, with w = x and w' = x', and is followed until the last.
        Accelerations of x, which are impulses at rigid stops, do not appear: between output times,
        x is the cubic through the displacements and velocities there, and w is exact for it. On a
        moving base, x is the displacement of the result and that of the base, by the loads of the
        request and the influence of its system.

        With the output ``impacts``, velocities jump at the times of the impacts. The jumps are
        proportional to the impulses; their ratios, one for each constraint, are those with which
        accelerations are continuous at the output times, by least squares. Without it, a jump
        of the velocity is spread over the interval h of the output times that contains it. This
        changes what the jump contributes by up to (Ω h)²/12 of its largest deflection: 5 % with 8
        output times in a period of the oscillator, 0.8 % with 20. The absolute acceleration, which
        jumps by 2 ζ Ω times the jump of the velocity, is off by up to a third of that.

        Parameters
        ----------
        dof : int, optional
            Degree of freedom; default: the first one with a stop, as in plots.
        frequencies : array, (start, stop, num) or mapping
            Natural frequencies of the oscillators without damping, positive.
        damping : float
            Their damping ratio, at least 0 and below 1.
        unit : str
            Unit of `frequencies`: "Hz", "rpm", "Omega" (angular) or "omega" (2/π of it).

        Returns
        -------
        ResponseSpectrum
            Largest relative displacement, pseudo-acceleration and absolute acceleration at each
            frequency, with estimates of their errors.

        Raises
        ------
        ValueError
            If x or v was not computed, there are fewer than three output times, or less than 8 in
            a period of the highest frequency, a number is out of range, or the base moves but the
            request does not have its influence.
        """
        return response_spectrum(self, dof, frequencies, damping, unit)


class SpectrumError(Table):
    """Estimated absolute errors of a response spectrum, each as the output of its name."""

    relative_displacement: Floats
    """Length."""
    pseudo_acceleration: Floats
    """Length / time²."""
    absolute_acceleration: Floats
    """Length / time²."""


@dataclass(frozen=True, eq=False)
class ResponseSpectrum:
    """The largest responses of oscillators that ride on a coordinate, see `Motion`.

    Parameters
    ----------
    frequencies : array, shape (frequency,)
        Natural frequencies of the oscillators without damping, in `unit`.
    relative_displacement : array, shape (frequency,)
        Largest absolute value of w - x, length.
    pseudo_acceleration : array, shape (frequency,)
        Square of the angular frequency times it, length / time².
    absolute_acceleration : array, shape (frequency,)
        Largest absolute value of w'', length / time².
    error : SpectrumError
        Estimates of their errors: how much the spectrum differs from that of every second output
        time. It is several times the error where the motion is smooth between output times, and
        no bound where it is not. Errors of the motion itself, ``result.error``, are not in it.
    unit : str
        Unit of the frequencies.
    damping : float
        Damping ratio of the oscillators.
    dof : int
        Degree of freedom on which they ride.
    acceleration_unit : str
        Unit of accelerations; "1" where the structure has no units.
    cautions : tuple of str
        What limits the spectrum: a motion that is not predictable until its end, or impacts at
        rigid stops that were not requested.
    """

    frequencies: Floats
    relative_displacement: Floats
    pseudo_acceleration: Floats
    absolute_acceleration: Floats
    error: SpectrumError
    unit: str
    damping: float
    dof: int
    acceleration_unit: str
    cautions: tuple[str, ...]

    def plot(self, ax: Axes | None = None) -> Axes:
        """Plot pseudo-acceleration and absolute acceleration over frequency, with their errors.

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw in; default: those of a new figure.
        """
        ax = ax or new_axes()
        lines = (
            ("pseudo_acceleration", "pseudo", ADMISSIBLE, "-"),
            ("absolute_acceleration", "absolute", OTHER, (0, (5, 1.5))),
        )
        order = np.argsort(self.frequencies, kind="stable")
        frequencies = self.frequencies[order]
        for name, text, color, style in lines:
            values, error = getattr(self, name)[order], self.error[name][order]
            ax.fill_between(
                frequencies, np.maximum(values - error, 0.0), values + error,
                color=color, alpha=0.2, linewidth=0.0,
            )  # fmt: skip
            ax.plot(frequencies, values, color=color, linestyle=style, linewidth=1.2, label=text)
        if frequencies[-1] > _DECADE * frequencies[0]:
            ax.set_xscale("log")
        ax.set_xlabel(f"frequency{self._unit()}")
        size = "" if self.acceleration_unit == "1" else f" ({self.acceleration_unit})"
        ax.set_ylabel(rf"acceleration on $x_{{{self.dof}}}$, $\zeta$ = {self.damping:g}{size}")
        ax.set_ylim(bottom=0.0)
        ax.margins(x=0.0)
        legend(ax)
        note(ax, self.cautions)
        return ax

    def _unit(self) -> str:
        return {"Hz": " (Hz)", "rpm": " (1/min)", "omega": r" $\omega$"}.get(
            self.unit, r" $\Omega$"
        )

    def __repr__(self) -> str:
        """Return what it is, its largest value and the largest of its errors."""
        highest = int(self.pseudo_acceleration.argmax())
        size = "" if self.acceleration_unit == "1" else f" {self.acceleration_unit}"
        largest = float(self.error.pseudo_acceleration.max())
        said = "".join(f"; {each}" for each in self.cautions)
        return (
            f"<ResponseSpectrum of coordinate {self.dof}: {self.frequencies.size} frequencies "
            f"{self.frequencies.min():.4g} to {self.frequencies.max():.4g} {self.unit}, damping "
            f"{self.damping:g}, pseudo-acceleration up to "
            f"{self.pseudo_acceleration[highest]:.4g}{size} at {self.frequencies[highest]:.4g} "
            f"{self.unit}, estimated errors up to {largest:.2g}{size}{said}>"
        )


def response_spectrum(
    result: Result,
    dof: int | None,
    frequencies: ArrayLike | tuple[float, float, int] | Mapping[str, Any],
    damping: float,
    unit: str,
) -> ResponseSpectrum:
    """Return the response spectrum of a coordinate, see `Motion.response_spectrum`."""
    missing = [name for name in ("x", "v") if name not in result]
    if missing:
        raise ValueError(
            f"a response spectrum needs x and v: the result has no {missing[0]}, which `outputs` "
            "of the request chooses"
        )
    if dof is not None and integer("dof", dof) not in result.dof:
        raise ValueError(f"dof {dof} was not computed, but {', '.join(map(str, result.dof))}")
    given = grids.values(frequencies, "frequencies")
    if given.ndim != 1 or not given.size or not np.all((given > 0.0) & np.isfinite(given)):
        raise ValueError("frequencies must be positive numbers")
    if not 0.0 <= number("damping", damping) < 1.0:
        raise ValueError(f"damping must be at least 0 and below 1, not {damping}")
    dof, column = column_of(result, dof)
    time = result.unit("t")
    angular = given * grids.angular(unit, "s" if time == "1" else time)
    t, x, v = result.t, result.x[:, column], result.v[:, column]
    _check_times(t, float(angular.max()))
    base = _base(result.request, dof, t)
    x, v, jumps = x + base[0], v + base[1], _jumps(result)
    half = np.union1d(np.arange(0, t.size, 2), t.size - 1)
    fine, coarse = (
        _spectrum(Pieces.of(t[some], x[some], v[some], jumps), angular, float(damping))
        for some in (slice(None), half)
    )
    error = np.abs(fine - coarse)
    return ResponseSpectrum(
        given, fine[0], fine[1], fine[2],
        SpectrumError(dict(zip(_OUTPUTS, error, strict=True))),
        unit, float(damping), dof,
        "1" if time == "1" else f"{result.unit('x')}/{time}^2",
        _cautions(result),
    )  # fmt: skip


_OUTPUTS: Final = ("relative_displacement", "pseudo_acceleration", "absolute_acceleration")


def _cautions(result: Result) -> tuple[str, ...]:
    """Return what limits a spectrum, a sentence each."""
    said, until, time = [], float(result.error.predictable_until), result.unit("t")
    laws = [(each.get("law") or {}).get("type", "rigid") for each in constraints_of(result)]
    soft = (result.request.get("limiter") or {}).get("law", "rigid") != "rigid"
    if "rigid" in laws and not soft and "impacts" not in result:
        said.append("impacts were not requested, so that jumps of the velocity are spread")
    if until < result.t[-1]:
        unit = "" if time == "1" else f" {time}"
        said.append(f"the motion is not predictable after {until:.4g}{unit}")
    return tuple(said)


def _spectrum(pieces: Pieces, angular: Floats, damping: float) -> Array:
    """Return the outputs at each angular frequency, shape (3, frequency)."""
    deflection, acceleration = np.array([largest(pieces, each, damping) for each in angular]).T
    return np.array([deflection, angular**2 * deflection, acceleration])


def _check_times(t: Floats, highest: float) -> None:
    """Refuse output times that are too few, or too far apart for an angular frequency."""
    if t.size < 3:
        raise ValueError(f"a response spectrum needs three output times or more, not {t.size}")
    apart, allowed = float(np.diff(t).max()), 2.0 * math.pi / (_PER_PERIOD * highest)
    if apart > allowed * (1.0 + 1e-9):
        raise ValueError(
            f"the output times are up to {apart:.4g} apart, and the highest of the frequencies "
            f"needs {_PER_PERIOD} in its period, {allowed:.4g} apart: request them with "
            f"t={math.ceil(float(t[-1] - t[0]) / allowed) + 1}, or leave high frequencies out"
        )


def _jumps(result: Result) -> Jumps:
    if "impacts" not in result:
        return Jumps.none()
    impacts = result.impacts
    return Jumps(impacts.time, -impacts.side * impacts.impulse, impacts.constraint)


def _base(request: Mapping[str, Any], dof: int, t: Floats) -> Floats:
    """Return displacement and velocity of a coordinate by the moving base, shape (2, t).

    They are those of a base whose displacement and velocity are 0 at its first sample; the rest
    is a motion of constant velocity, which no oscillator feels.
    """
    moved = np.zeros((2, t.size))
    for term in request.get("load") or ():
        if "base" in term:
            base = term["base"]
            influence = request["system"].get("influence") if isinstance(base, str) else base
            if influence is None:
                raise ValueError(
                    "the base moves, but the request does not have the influence of its system: "
                    "give it to the structure as influence=, or to vi.base_motion as base="
                )
            of = _sampled_base if "acceleration" in term else _harmonic_base
            moved += influence[dof] * of(term, t)
    return moved


def _harmonic_base(term: Mapping[str, Any], t: Floats) -> Floats:
    """Return displacement and velocity of a base that vibrates, shape (2, t)."""
    rate = 1j * term["frequency"]
    order = ("displacement", "velocity", "acceleration").index(term["base"])
    phase = term.get("phase", 0.0)
    turning = term["amplitude"] / rate**order * np.exp(rate * t + 1j * phase)
    return np.array([turning.real, (rate * turning).real])


def _sampled_base(term: Mapping[str, Any], t: Floats) -> Floats:
    """Return displacement and velocity of a base whose acceleration is linear between samples."""
    a = np.asarray(term["acceleration"], dtype=np.float64)
    times = term.get("t")
    at = term["interval"] * np.arange(a.size) if times is None else np.asarray(times, dtype=float)
    h = np.diff(at)
    v = np.append(0.0, np.cumsum(0.5 * h * (a[:-1] + a[1:])))
    x = np.append(0.0, np.cumsum(h * (v[:-1] + h * (a[:-1] / 3.0 + a[1:] / 6.0))))
    last = np.clip(np.searchsorted(at, t, side="right") - 1, 0, h.size - 1)
    s, slope = t - at[last], (np.diff(a) / h)[last]
    a, v, x = a[last], v[last], x[last]
    return np.array([
        x + s * (v + s * (a / 2.0 + s * slope / 6.0)), v + s * (a + s * slope / 2.0)
    ])  # fmt: skip
