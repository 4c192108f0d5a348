"""Motions under periodic loads, as methods."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from vibroimpact import arguments
from vibroimpact.arguments import names
from vibroimpact.computations.base import AnyComputation
from vibroimpact.computations.fields import (
    drive_terms,
    indices,
    initial_states,
    integer,
    number,
    present,
    values,
)
from vibroimpact.grids import frequencies

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from vibroimpact import documents
    from vibroimpact.arguments import Document
    from vibroimpact.computations.fields import Initials, Values

Motions = TypeVar("Motions")
Curves = TypeVar("Curves")
Settled = TypeVar("Settled")


class DrivenComputations(AnyComputation, Generic[Motions, Curves, Settled]):
    """Computations of motions under periodic loads."""

    def periodic_motions(
        self,
        system: documents.System,
        frequency: Values,
        load: Sequence[documents.DriveTerm] = (),
        *,
        unit: str = "Omega",
        sequence: str | Sequence[tuple[int, str] | Mapping[str, Any]] | None = None,
        constraint: int = 0,
        periods: int = 1,
        phases: ArrayLike | None = None,
        outputs: Sequence[str] | None = None,
        dofs: Sequence[int] | None = None,
        tau: ArrayLike | None = None,
        tolerance: float | None = None,
    ) -> Motions:
        """Find the periodic motions of a driven, damped structure that hits its limiters.

        Parameters
        ----------
        system : dict
            The structure, from `system`, `chain` or another function of `vibroimpact.systems`.
        frequency : array, (start, stop, num) or dict
            Frequencies Omega of the drive, or in Hz or rpm with ``unit="Hz"`` or ``unit="rpm"``.
        load : sequence of dict
            Terms of the drive, from `drive`; empty: free motions of a structure without losses.
        sequence : "symmetric" or sequence of (int, str), optional
            Impacts of one period as (constraint, "upper" or "lower"), or as requests have them; or
            one at each wall of a constraint half a period apart; default: one at the upper wall
            of constraint 0.
        constraint : int
            The one that a symmetric motion strikes.
        periods : int
            Periods of the drive in one period of the motion.
        phases : array, shape (guess, impact), optional
            Phases Omega t of the impacts with which the search for several impacts per period
            begins; one and symmetric impacts need none.
        outputs : sequence of str, optional
            Quantities to compute: exists, extremes, energy, stability, multipliers, waveform;
            default: all, the waveform where `tau` is given.
        dofs : sequence of int, optional
            Degrees of freedom of extremes and waveform; default: all.
        tau : array, optional
            Times t/T of the waveform, from the drive's phase 0.
        tolerance : float, optional
            Relative error of the impulses; the result tells which solutions meet it.
        """
        request = {
            "system": dict(system),
            "frequency": frequencies(frequency, unit),
            "load": drive_terms(load),
        }
        options = present(
            sequence=sequence
            if sequence is None or isinstance(sequence, str)
            else [_impact(each) for each in sequence],
            constraint=arguments.integer("constraint", constraint) or None,
            periods=None if periods == 1 else arguments.integer("periods", periods),
            start=None if phases is None else {"phases": arguments.rows("phases", phases)},
            outputs=None if outputs is None else names(outputs),
            dofs=indices("dofs", dofs),
            tau=values("tau", tau),
            tolerance=number("tolerance", tolerance),
        )
        answer: Motions = self._compute("periodic-motions", request | options)
        return answer

    def branches(
        self,
        base: documents.PeriodicMotionsRequest,
        path: str,
        start: float,
        stop: float,
        *,
        switch: int = 0,
        stop_at: Sequence[str] = (),
        points: int | None = None,
        step: float | None = None,
        progress: bool = False,
    ) -> Curves:
        """Follow branches of periodic motions over a range of one number of their request.

        Parameters
        ----------
        base : dict
            A request for periodic motions at one frequency, from `periodic_motions_request`.
        path : str
            The number that varies, such as "frequency.values.0" or "system.constraints.0.gap".
        start, stop : float
            Ends of the range.
        switch : int
            How many branches to follow that begin at flips and losses of symmetry.
        stop_at : sequence of str
            Special points at which a branch ends: fold, flip, torus, symmetry, grazing, end.
        points : int, optional
            Most points of a branch.
        step : float, optional
            Longest step: part of the range, change of a phase (rad) or relative one of an impulse.
        progress : bool
            Show a progress bar while a job runs.
        """
        request: Document = {
            "base": dict(base),
            "path": path,
            "start": arguments.number("start", start),
            "stop": arguments.number("stop", stop),
        }
        options = present(
            switch=arguments.integer("switch", switch) or None,
            stop_at=names(stop_at) or None,
            points=integer("points", points),
            step=number("step", step),
        )
        answer: Curves = self._compute("branches", request | options, progress=progress)
        return answer

    def attractors(
        self,
        system: documents.System,
        frequency: float | Sequence[float] | Mapping[str, Any],
        load: Sequence[documents.DriveTerm],
        x: ArrayLike | None = None,
        v: ArrayLike | None = None,
        *,
        initial: Initials | None = None,
        unit: str = "Omega",
        settle: int | None = None,
        observe: int | None = None,
        longest: int | None = None,
        section: str = "phase",
        points: int | None = None,
        dofs: Sequence[int] | None = None,
        outputs: Sequence[str] | None = None,
        tolerance: float | None = None,
        progress: bool = False,
    ) -> Settled:
        """Find what the motions of a driven structure with stops settle on, and how many do.

        Parameters
        ----------
        system : dict
            The structure, with damping or losses at its stops.
        frequency : float or dict
            Frequency of the drive, Omega, or in Hz or rpm with ``unit="Hz"`` or ``unit="rpm"``; a
            list has one.
        load : sequence of dict
            The drive, from `drive`.
        x, v : array, shape (motion, dof)
            Displacements and velocities at t = 0, the drive's phase 0.
        initial : (x, v) or float or dict or sequence of dict, optional
            In place of x and v: the same as one argument, as `time_history` takes it; of several
            dictionaries, each with x and v or with an impact mode, each is a motion.
        settle, observe : int, optional
            Periods of the drive that are left out, and those looked at after them; default: 200
            and 400.
        longest : int, optional
            Largest period, in periods of the drive, that is recognised; default: 16.
        section : str
            Points of the section: "phase", the states at the drive's phase 0, or "impacts".
        points : int, optional
            Most points of the section of each attractor; default: 200.
        dofs : sequence of int, optional
            Degrees of freedom of states and sections; default: all.
        outputs : sequence of str, optional
            section, stability; default: both.
        tolerance : float, optional
            Distance of equal states relative to the amplitude; default: 1e-6.
        progress : bool
            Show a progress bar while a job runs.
        """
        request: Document = {
            "system": dict(system),
            "load": drive_terms(load),
            "frequency": frequencies(frequency, unit),
            "initial": initial_states(x, v, initial),
        }
        options = present(
            settle=integer("settle", settle),
            observe=integer("observe", observe),
            longest=integer("longest", longest),
            section=None if section == "phase" else section,
            points=integer("points", points),
            dofs=indices("dofs", dofs),
            outputs=None if outputs is None else names(outputs),
            tolerance=number("tolerance", tolerance),
        )
        answer: Settled = self._compute("attractors", request | options, progress=progress)
        return answer


def _impact(given: tuple[int, str] | Mapping[str, Any]) -> dict[str, Any]:
    """Return the document of an impact: of a constraint and a side, or as requests have it."""
    if isinstance(given, Mapping):
        return dict(given)
    index, side = given
    return {"constraint": arguments.integer("constraint", index), "side": side}
