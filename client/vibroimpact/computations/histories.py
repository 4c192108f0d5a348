"""Motions from given initial states, as methods."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from vibroimpact import arguments
from vibroimpact.arguments import names
from vibroimpact.computations.base import AnyComputation
from vibroimpact.computations.fields import (
    indices,
    initial_state,
    initial_states,
    integer,
    number,
    output_times,
    present,
)
from vibroimpact.grids import times
from vibroimpact.stops import has_stiff_stops

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from vibroimpact import documents
    from vibroimpact.arguments import Document
    from vibroimpact.computations.fields import Initial, Initials, Values

    Load = (
        documents.HarmonicLoad
        | documents.SampledLoad
        | documents.BaseMotion
        | documents.HarmonicBase
    )
    Limiter = documents.PowerLimiter | documents.RigidLimiter

History = TypeVar("History")
Many = TypeVar("Many")
Slow = TypeVar("Slow")


class HistoryComputations(AnyComputation, Generic[History, Many, Slow]):
    """Computations of motions from given initial states."""

    def time_history(
        self,
        system: documents.System,
        initial: Initial | None = None,
        t_end: float | None = None,
        *,
        t: Values | None = None,
        outputs: Sequence[str] | None = None,
        dofs: Sequence[int] | None = None,
        load: Sequence[Load] | None = None,
        limiter: Limiter | None = None,
        method: str = "exact",
        tolerance: float | None = None,
        digits: int | None = None,
        derivatives: Sequence[str] | None = None,
    ) -> History:
        """Compute the motion from an initial state, with its impacts.

        Parameters
        ----------
        system : dict
            The structure, from `system`, `chain` or another function of `vibroimpact.systems`.
        initial : (x, v) or float or dict, optional
            Displacements and velocities at t = 0; or the frequency Omega of an impact mode, on
            which the motion starts; or the document itself. Default: at rest, all zero.
        t_end : float
            Duration of the motion.
        t : int, array, (start, stop, num) or dict, optional
            Output times, or the number of equally spaced ones from 0 to `t_end`.
        outputs : sequence of str, optional
            Quantities to compute: x, v, a, impacts, energy, contacts, force; default: contacts and
            impacts and, where `t` is given, x, v and energy; of stops with a stiffness, whose
            contacts are no impacts, contacts and their force.
        dofs : sequence of int, optional
            Degrees of freedom of x, v and a; default: all.
        load : sequence of dict, optional
            Loads, from `harmonic`, `sampled`, `base_motion` and `base_vibration`.
        limiter : dict, optional
            The force law of soft limiters, from `soft`; default: the laws of the constraints.
        method : str
            "exact", or an integrator of scipy for comparison: RK45, DOP853, Radau, LSODA, …
        tolerance : float, optional
            Required accuracy, relative to the size of the motion; the result states until when
            double precision can meet it.
        digits : int, optional
            Decimal digits to compute with where double precision cannot meet the tolerance.
        derivatives : sequence of str, optional
            Paths of numbers by which the outputs are differentiated, such as
            ``"system.constraints.0.gap"``, ``"load.0.amplitude"`` or ``"initial.v.0"``;
            ``result.derivative("x", "gap")`` and ``result.derivative("impacts.time", "gap")``
            return one.
        """
        request = _motion(
            system,
            None if initial is None else initial_state(initial),
            t_end,
            t=t,
            outputs=outputs,
            dofs=dofs,
            load=load,
            limiter=limiter,
            method=method,
            tolerance=tolerance,
        )
        options = present(
            digits=integer("digits", digits),
            derivatives=None if derivatives is None else names(derivatives),
        )
        answer: History = self._compute("time-history", request | options)
        return answer

    def ensemble(
        self,
        system: documents.System,
        x: ArrayLike | None = None,
        v: ArrayLike | None = None,
        t_end: float | None = None,
        *,
        initial: Initials | None = None,
        t: Values | None = None,
        outputs: Sequence[str] | None = None,
        dofs: Sequence[int] | None = None,
        load: Sequence[Load] | None = None,
        limiter: Limiter | None = None,
        method: str = "exact",
        tolerance: float | None = None,
    ) -> Many:
        """Compute the motions from many initial states.

        `Result.each` returns the impacts of every member, ``result.plot()`` draws the basins.

        Parameters
        ----------
        system : dict
            The structure, from `system`, `chain` or another function of `vibroimpact.systems`.
        x, v : array, shape (member, dof)
            Displacements and velocities at t = 0.
        t_end : float
            Duration of the motions.
        initial : (x, v) or float or dict or sequence of dict, optional
            In place of x and v: the same as one argument, as `time_history` takes it; of several
            dictionaries, each with x and v or with an impact mode, each is a motion.
        t, outputs, dofs, load, limiter, method, tolerance
            As for `time_history`; they hold for all members.
        """
        request = _motion(
            system,
            initial_states(x, v, initial),
            t_end,
            t=t,
            outputs=outputs,
            dofs=dofs,
            load=load,
            limiter=limiter,
            method=method,
            tolerance=tolerance,
        )
        answer: Many = self._compute("ensemble", request)
        return answer

    def slow_flow(
        self,
        system: documents.System,
        model: str,
        variant: str,
        initial: documents.SlowFlowInitial | Mapping[str, float],
        t: Values,
        *,
        outputs: Sequence[str] = ("state", "x", "v", "error"),
    ) -> Slow:
        """Compute a motion with slowly varying impacts, and the error of the description used.

        Parameters
        ----------
        system : dict
            The system of the model, from `oscillator`, `two_mass` or `bouncing_ball`.
        model : str
            ``damped`` (eq. 10.13-10.21), ``two_oscillator`` (10.41-10.46), ``restitution``
            (10.90-10.123), ``bouncing_ball`` (10.124-10.149) or ``oscillator`` (10.1-10.12).
        variant : str
            Description of the motion, such as ``exact``, ``averaged`` or ``corrected``.
        initial : mapping
            Initial conditions, such as ``{"gamma": 0.2}`` or ``{"omega": 5}``.
        t : array, (start, stop, num) or dict
            Output times.
        outputs : sequence of str
            Quantities to compute: state, x, v, impulse, error.
        """
        given: Mapping[str, Any] = initial
        request = {
            "system": dict(system),
            "model": model,
            "variant": variant,
            "initial": {
                name: value if name == "root" else arguments.number(name, value)
                for name, value in given.items()
            },
            "t": times(t, "t"),
            "outputs": names(outputs),
        }
        answer: Slow = self._compute("slow-flow", request)
        return answer


def _motion(
    system: Mapping[str, Any],
    initial: Document | None,
    t_end: float | None,
    *,
    t: Any,
    outputs: Sequence[str] | None,
    dofs: Sequence[int] | None,
    load: Any,
    limiter: Any,
    method: str,
    tolerance: float | None,
) -> Document:
    """Return what requests of one motion and of many have in common."""
    if t_end is None:
        raise TypeError("t_end is missing, the duration of the motion")
    if outputs is None:
        outputs = () if t is None else ("x", "v", "energy")
        if has_stiff_stops(system):
            outputs = (*outputs, "contacts", *(() if t is None else ("force",)))
        else:
            outputs = (*outputs, "impacts", "contacts")
    request = {
        "system": dict(system),
        **({} if initial is None else {"initial": initial}),
        "t_end": arguments.number("t_end", t_end),
        "outputs": names(outputs),
    }
    return request | present(
        t=output_times(t),
        dofs=indices("dofs", dofs),
        load=None if load is None else arguments.documents("load", load),
        limiter=None if limiter is None else dict(limiter),
        method=None if method == "exact" else method,
        tolerance=number("tolerance", tolerance),
    )
