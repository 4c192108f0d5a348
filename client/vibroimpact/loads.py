"""Documents of loads: of time histories, and of periodic motions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal

from vibroimpact.arguments import Document, integer, number, numbers
from vibroimpact.stops import direction_of

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from vibroimpact import documents

    BaseQuantity = Literal["acceleration", "velocity", "displacement"]


def harmonic(
    dof: int, amplitude: float, frequency: float, phase: float = 0.0
) -> documents.HarmonicLoad:
    """Return a load ``amplitude cos(frequency t + phase)`` on one degree of freedom.

    It is a load of time histories and ensembles; that of periodic motions comes from `drive`.

    Parameters
    ----------
    dof : int
        The degree of freedom on which it acts.
    amplitude : float
        Force, mass length / time².
    frequency : float
        Angular frequency, radians by the structure's unit of time: 2 π f of f in Hz.
    phase : float
        Phase in radians.
    """
    return {
        "dof": integer("dof", dof),
        "amplitude": number("amplitude", amplitude),
        "frequency": number("frequency", frequency),
        "phase": number("phase", phase),
    }


def sampled(
    dof: int | Mapping[int, float],
    force: ArrayLike,
    t: ArrayLike | None = None,
    *,
    interval: float | None = None,
) -> documents.SampledLoad:
    """Return a load given by samples, a straight line from each to the next.

    Parameters
    ----------
    dof : int or dict
        The degree of freedom on which it acts, or several as {dof: weight}.
    force : array
        Its values, mass length / time².
    t : array, optional
        Their times, from 0 or before to the end of the motion or after.
    interval : float, optional
        In place of `t`: the time between two samples, the first one at 0.
    """
    load: Any = _place(dof) | {"force": numbers("force", force)} | _sample_times(t, interval)
    document: documents.SampledLoad = load
    return document


def base_motion(
    base: ArrayLike | str,
    acceleration: ArrayLike,
    t: ArrayLike | None = None,
    *,
    interval: float | None = None,
) -> documents.BaseMotion:
    """Return a moving base as a load; displacements and velocities are then relative to it.

    Parameters
    ----------
    base : array
        Displacements of the structure by a unit displacement of the base: 1 for every degree of
        freedom in its direction; or "acceleration": they are the `influence` of the system.
    acceleration : array
        That of the base, a straight line from each sample to the next.
    t, interval : optional
        As for `sampled`.
    """
    moved = base if isinstance(base, str) else numbers("base", base)
    parts: Document = {"base": moved, "acceleration": numbers("acceleration", acceleration)}
    load: Any = parts | _sample_times(t, interval)
    document: documents.BaseMotion = load
    return document


def base_vibration(
    quantity: BaseQuantity,
    amplitude: float,
    frequency: float,
    phase: float = 0.0,
) -> documents.HarmonicBase:
    """Return a base that moves by ``amplitude cos(frequency t + phase)``, as a load of histories.

    Displacements and velocities are relative to it. The system has its `influence`.

    Parameters
    ----------
    quantity : str
        What of the base the amplitude is: "acceleration", "velocity" or "displacement".
    amplitude, frequency, phase : float
        The frequency is angular.
    """
    return {
        "base": quantity,
        "amplitude": number("amplitude", amplitude),
        "frequency": number("frequency", frequency),
        "phase": number("phase", phase),
    }


def drive(
    dof: int | Mapping[int, float] | None = None,
    amplitude: float = 1.0,
    harmonic: int = 1,
    phase: float = 0.0,
    *,
    base: str | None = None,
    scale: str | None = None,
) -> documents.DriveTerm:
    """Return a load ``amplitude cos(harmonic Omega t + phase)`` of periodic motions.

    Parameters
    ----------
    dof : int or mapping
        The degree of freedom on which it acts, or several given as {dof: weight}.
    amplitude, harmonic, phase
        As above.
    base : str, optional
        Instead of `dof`: "acceleration", "velocity" or "displacement" of the base, by the
        `influence` of the system; displacements are then relative to it.
    scale : str, optional
        "Omega2" multiplies the amplitude by the square of Omega, as of an unbalance.
    """
    terms = {
        "amplitude": number("amplitude", amplitude),
        "harmonic": integer("harmonic", harmonic),
        "phase": number("phase", phase),
    }
    load: Any = _place(dof) | terms
    if base is not None:
        load["base"] = base
    if scale is not None:
        load["scale"] = scale
    document: documents.DriveTerm = load
    return document


def _sample_times(t: Any, interval: float | None) -> Document:
    given: Document = {} if t is None else {"t": numbers("t", t)}
    return given if interval is None else given | {"interval": number("interval", interval)}


def _place(dof: int | Mapping[int, float] | None) -> Document:
    if dof is None:
        return {}
    if not isinstance(dof, Mapping):
        return {"dof": integer("dof", dof)}
    return {"direction": direction_of(dof)}
