"""Natural modes, and impact modes with what follows from them, as methods."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Generic, TypeVar

from vibroimpact import arguments
from vibroimpact.arguments import names
from vibroimpact.computations.base import AnyComputation
from vibroimpact.computations.fields import indices, integer, number, present, values
from vibroimpact.grids import frequencies

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from vibroimpact import documents
    from vibroimpact.arguments import Document
    from vibroimpact.computations.fields import Values

Natural = TypeVar("Natural")
Modes = TypeVar("Modes")
Bands = TypeVar("Bands")
Resonant = TypeVar("Resonant")


class ModeComputations(AnyComputation, Generic[Natural, Modes, Bands, Resonant]):
    """Computations of free periodic motions."""

    def natural_frequencies(
        self,
        system: documents.System,
        count: int | None = None,
        *,
        stop: float | None = None,
        unit: str = "Omega",
        fixed: Sequence[int] = (),
        directions: ArrayLike | None = None,
        outputs: Sequence[str] | None = None,
        tolerance: float | None = None,
        derivatives: Sequence[str] | None = None,
    ) -> Natural:
        """Compute the natural frequencies and mode shapes of a structure, without damping.

        ``result.in_unit(result.Omega, "Hz")`` returns the frequencies in Hz; printed, the result
        is a table of them.

        Parameters
        ----------
        system : dict
            The structure, from `system`, `chain` or another function of `vibroimpact.systems`.
        count : int, optional
            Number of modes, from the lowest; default: 10, or all up to `stop`.
        stop : float, optional
            Instead of `count`: the frequency up to which all modes are returned.
        unit : str
            Unit of `stop`: Omega (angular), Hz or rpm.
        fixed : sequence of int
            Indices of the constraints whose coordinates are held at zero.
        directions : array, shape (direction, dof), optional
            Displacements of all degrees of freedom by unit motions of the base, for effective
            masses.
        outputs : sequence of str, optional
            Quantities to compute: Omega, shape, participation, effective_mass,
            residual_flexibility; default: the first three, and effective masses where
            `directions` are given.
        tolerance : float, optional
            Relative error of the frequencies; the result tells which meet it.
        derivatives : sequence of str, optional
            Paths of numbers by which the outputs are differentiated, such as
            ``"system.K.scale"``; ``result.derivative("Omega", "K.scale")`` returns one.
        """
        if outputs is None and directions is not None:
            outputs = ("Omega", "shape", "participation", "effective_mass")
        options = present(
            count=integer("count", count),
            stop=number("stop", stop),
            unit=None if unit == "Omega" else unit,
            fixed=indices("fixed", fixed) or None,
            directions=None if directions is None else arguments.rows("directions", directions),
            outputs=None if outputs is None else names(outputs),
            tolerance=number("tolerance", tolerance),
            derivatives=None if derivatives is None else names(derivatives),
        )
        request: Document = {"system": dict(system)}
        answer: Natural = self._compute("natural-frequencies", request | options)
        return answer

    def impact_modes(
        self,
        system: documents.System,
        frequency: Values,
        *,
        unit: str = "Omega",
        outputs: Sequence[str] = ("impulse", "exists", "reason"),
        active: Sequence[int] | None = None,
        dofs: Sequence[int] | None = None,
        tau: ArrayLike | None = None,
        derivatives: Sequence[str] | None = None,
    ) -> Modes:
        """Compute impact modes, eq. 10.49-10.59 and 10.87-10.89.

        Parameters
        ----------
        system : dict
            The structure, from `system`, `chain` or another function of `vibroimpact.systems`.
        frequency : array, (start, stop, num) or dict
            Fundamental angular frequencies Omega; frequencies omega of the triangle wave with
            ``unit="omega"``, Omega/(2 pi) in Hz or per minute with ``unit="Hz"`` or ``"rpm"``.
        outputs : sequence of str
            Quantities to compute: impulse, exists, reason, shape, waveform, energy, stability,
            harmonics.
        active : sequence of int, optional
            Indices of the constraints that are struck; default: all.
        dofs : sequence of int, optional
            Degrees of freedom of shape and waveform; default: all.
        tau : array, optional
            Triangle-wave times of the waveform.
        derivatives : sequence of str, optional
            Paths of numbers by which the outputs are differentiated, such as
            ``"system.constraints.0.gap"``, ``"system.K.scale"`` or ``"frequency"``;
            ``result.derivative("momentum", "gap")`` returns one.
        """
        request = {
            "system": dict(system),
            "frequency": frequencies(frequency, unit),
            "outputs": names(outputs),
        }
        options = present(
            active=indices("active", active),
            dofs=indices("dofs", dofs),
            tau=values("tau", tau),
            derivatives=None if derivatives is None else names(derivatives),
        )
        answer: Modes = self._compute("impact-modes", request | options)
        return answer

    def existence_bands(
        self,
        system: documents.System,
        start: float | tuple[float, float],
        stop: float | None = None,
        *,
        unit: str = "Omega",
        outputs: Sequence[str] = ("bands", "rejected"),
        active: Sequence[int] | None = None,
        tolerance: float | None = None,
        resolution: float | None = None,
    ) -> Bands:
        """Find the frequency bands in which impact modes are admissible.

        Parameters
        ----------
        system : dict
            The structure, from `system`, `chain` or another function of `vibroimpact.systems`.
        start, stop : float
            Ends of the frequency range, also as one pair: Omega, or omega, Hz or rpm by `unit`.
        outputs : sequence of str
            Tables to compute: bands, rejected, stability.
        active : sequence of int, optional
            Indices of the constraints that are struck; default: all.
        tolerance : float, optional
            Relative width to which band edges are located.
        resolution : float, optional
            Width, relative to that of the range, from which on all bands and gaps are found:
            narrower ones only by chance, and ``result.error.complete`` is false. Finite-element
            models have so many narrow bands that all of them take long.
        """
        ends = (start, stop) if stop is not None else start
        given = arguments.numbers("the range", ends)
        if len(given) != 2:
            raise TypeError("a range has two ends: start and stop, or one pair of them")
        low, high = given
        request = {
            "system": dict(system),
            "frequency": {"start": low, "stop": high, "unit": unit},
            "outputs": names(outputs),
        }
        options = present(
            active=indices("active", active),
            tolerance=number("tolerance", tolerance),
            resolution=number("resolution", resolution),
        )
        answer: Bands = self._compute("existence-bands", request | options)
        return answer

    def resonances(
        self, system: documents.System, constraint: int = 0, odd_max: int = 9
    ) -> Resonant:
        """Find the internal resonances of a structure, eq. 10.70-10.76.

        These are the natural frequencies of the structure with the constrained coordinate held
        fixed, divided by odd numbers.

        Parameters
        ----------
        system : dict
            The structure, from `system`, `chain` or another function of `vibroimpact.systems`.
        constraint : int
            Index of the constraint whose coordinate is held fixed.
        odd_max : int
            Highest odd harmonic.
        """
        numbers = {
            "constraint": arguments.integer("constraint", constraint),
            "odd_max": arguments.integer("odd_max", odd_max),
        }
        answer: Resonant = self._compute("resonances", {"system": dict(system)} | numbers)
        return answer
