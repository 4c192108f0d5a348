"""The results of each kind of computation: which outputs there are, and what they mean.

Written by ``client/write_types.py`` from the declarations of the solvers. Outputs are absent where
they were not requested.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Final

from vibroimpact.derivatives import Derivatives
from vibroimpact.errors import warn_of_structure
from vibroimpact.parts import Parts
from vibroimpact.response_spectra import Motion
from vibroimpact.result_file import reading
from vibroimpact.results import Result
from vibroimpact.tables import Table

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from vibroimpact import documents

    Floats = NDArray[np.float64]
    Integers = NDArray[np.int64]
    Booleans = NDArray[np.bool_]
    Words = NDArray[np.str_]


class NaturalFrequenciesErrorDerivative(Table):
    """Absolute errors of the derivatives."""

    Omega: Floats
    """Error of the derivative of the natural angular frequency, shape (mode, parameter),
    1/time; nan: unbounded, or there is no derivative.
    """
    shape: Floats
    """Error of the derivative of the mode shape, shape (mode, dof, parameter), 1/√mass; nan:
    unbounded, or there is no derivative.
    """
    participation: Floats
    """Error of the derivative of the constrained coordinate of the mode shape, shape (mode,
    constraint, parameter), 1/√mass; nan: unbounded, or there is no derivative.
    """
    effective_mass: Floats
    """Error of the derivative of the effective modal mass, shape (mode, direction, parameter),
    mass; nan: unbounded, or there is no derivative.
    """
    residual_flexibility: Floats
    """Error of the derivative of the static flexibility of all modes that are left out, shape
    (constraint, other, parameter), time² / mass; nan: unbounded, or there is no derivative.
    """


class NaturalFrequenciesError(Table):
    """Absolute errors of the outputs."""

    PARTS: ClassVar[dict[str, type[Table]]] = {"derivative": NaturalFrequenciesErrorDerivative}
    statement: str
    """How the errors were obtained."""
    Omega: Floats
    """Absolute error of Omega, shape (mode), 1/time."""
    shape: Floats
    """Absolute error of the mode shape, shape (mode, dof), 1/√mass; nan: the mode cannot be
    told from its neighbours.
    """
    participation: Floats
    """Absolute error of the participation, shape (mode, constraint), 1/√mass; nan: the mode
    cannot be told from its neighbours.
    """
    effective_mass: Floats
    """Absolute error of the effective modal mass, shape (mode, direction), mass; nan: the mode
    cannot be told from its neighbours.
    """
    residual_flexibility: Floats
    """Absolute error of the residual flexibility, shape (constraint, other), time² / mass;
    nan: the mode cannot be told from its neighbours.
    """
    within_tolerance: Words
    """Whether the relative error of Omega is within the requested tolerance, shape (mode)."""
    derivative: NaturalFrequenciesErrorDerivative
    """Absolute errors of the derivatives."""


class NaturalFrequenciesDerivative(Derivatives):
    """Derivatives of the outputs by the parameters, per unit of the parameter."""

    parameter: Words
    """Path of the parameter of the derivatives, shape (parameter)."""
    unit: Words
    """Unit of the parameter, by which those of the derivatives are divided, shape (parameter)."""
    reason: Words
    """Why there is no derivative, or ok, shape (mode, parameter); of repeated frequencies,
    that of Omega is for a parameter that grows.
    """
    distance: Floats
    """Change of the parameter to where there is no derivative, to first order, shape (mode,
    parameter); where a mode meets its neighbour, or its frequency is 0; nan: none is in sight.
    """
    Omega: Floats
    """Derivative of the natural angular frequency by the parameter, shape (mode, parameter),
    1/time; nan: there is none, see reason.
    """
    shape: Floats
    """Derivative of the mode shape by the parameter, shape (mode, dof, parameter), 1/√mass;
    nan: there is none, see reason.
    """
    participation: Floats
    """Derivative of the constrained coordinate of the mode shape by the parameter, shape
    (mode, constraint, parameter), 1/√mass; nan: there is none, see reason.
    """
    effective_mass: Floats
    """Derivative of the effective modal mass by the parameter, shape (mode, direction,
    parameter), mass; nan: there is none, see reason.
    """
    residual_flexibility: Floats
    """Derivative of the static flexibility of all modes that are left out by the parameter,
    shape (constraint, other, parameter), time² / mass; nan: there is none, see reason.
    """


class ImpactModesFrequency(Table):
    """The frequencies, as Omega and as omega."""

    Omega: Floats
    """Fundamental angular frequency, shape (Omega), 1/time."""
    omega: Floats
    """Triangle-wave frequency, shape (Omega), 1/time; (2/pi) Omega."""


class ImpactModesErrorDerivative(Table):
    """Absolute errors of the derivatives."""

    impulse: Floats
    """Error of the derivative of the impulse parameter p, upper wall, shape (Omega,
    constraint, parameter), mass length / time²; nan: unbounded, or there is no derivative.
    """
    impulse_lower: Floats
    """Error of the derivative of the impulse parameter p, lower wall, shape (Omega,
    constraint, parameter), mass length / time²; nan: unbounded, or there is no derivative.
    """
    momentum: Floats
    """Error of the derivative of the momentum exchanged at each impact, upper wall, shape
    (Omega, constraint, parameter), mass length / time; nan: unbounded, or there is no
    derivative.
    """
    momentum_lower: Floats
    """Error of the derivative of the momentum exchanged at each impact, lower wall, shape
    (Omega, constraint, parameter), mass length / time; nan: unbounded, or there is no
    derivative.
    """
    shape: Floats
    """Error of the derivative of the displacement at tau = 1, shape (Omega, dof, parameter),
    length; nan: unbounded, or there is no derivative.
    """
    waveform: Floats
    """Error of the derivative of the displacement, shape (Omega, tau, dof, parameter), length;
    nan: unbounded, or there is no derivative.
    """
    energy: Floats
    """Error of the derivative of the total energy, shape (Omega, parameter), mass length² /
    time²; nan: unbounded, or there is no derivative.
    """
    harmonics: Floats
    """Error of the derivative of the Fourier amplitude, shape (Omega, harmonic, dof,
    parameter), length; nan: unbounded, or there is no derivative.
    """


class ImpactModesError(Table):
    """Errors of the outputs."""

    PARTS: ClassVar[dict[str, type[Table]]] = {"derivative": ImpactModesErrorDerivative}
    impulse: Floats
    """Error of the impulse parameter p, upper wall, shape (Omega, constraint), mass length /
    time²; the same at all walls of a solution; nan: unbounded.
    """
    impulse_lower: Floats
    """Error of the impulse parameter p, lower wall, shape (Omega, constraint), mass length /
    time²; nan: unbounded.
    """
    momentum: Floats
    """Error of the momentum exchanged at each impact, upper wall, shape (Omega, constraint),
    mass length / time; nan: unbounded.
    """
    momentum_lower: Floats
    """Error of the momentum exchanged at each impact, lower wall, shape (Omega, constraint),
    mass length / time; nan: unbounded.
    """
    relative: Floats
    """Error of the impulses relative to the largest of them, at most 1, shape (Omega); nan:
    unknown.
    """
    condition: Floats
    """Magnification of relative rounding errors in the impulses, shape (Omega); nan:
    unbounded.
    """
    stability: Floats
    """Error of the spectral radius, shape (Omega); nan: there is none, or it is unbounded."""
    shape: Floats
    """Error of the shape, shape (Omega, dof), length; nan: unbounded."""
    waveform: Floats
    """Error of the waveform at all times, shape (Omega, one, dof), length; nan: unbounded."""
    energy: Floats
    """Error of the total energy, shape (Omega), mass length² / time²; nan: unbounded."""
    harmonics: Floats
    """Error of the Fourier amplitudes of all orders, shape (Omega, one, dof), length; nan:
    unbounded.
    """
    within_tolerance: Words
    """Whether the relative error of the impulses is within the requested tolerance, shape
    (Omega).
    """
    statement: str
    """How the errors were obtained."""
    derivative: ImpactModesErrorDerivative
    """Absolute errors of the derivatives."""


class ImpactModesDerivative(Derivatives):
    """Derivatives of the outputs by the parameters, per unit of the parameter."""

    parameter: Words
    """Path of the parameter of the derivatives, shape (parameter)."""
    unit: Words
    """Unit of the parameter, by which those of the derivatives are divided, shape (parameter)."""
    reason: Words
    """Why there is no derivative, or ok, shape (Omega, parameter)."""
    impulse: Floats
    """Derivative of the impulse parameter p, upper wall by the parameter, shape (Omega,
    constraint, parameter), mass length / time²; nan: there is none, see reason.
    """
    impulse_lower: Floats
    """Derivative of the impulse parameter p, lower wall by the parameter, shape (Omega,
    constraint, parameter), mass length / time²; nan: there is none, see reason.
    """
    momentum: Floats
    """Derivative of the momentum exchanged at each impact, upper wall by the parameter, shape
    (Omega, constraint, parameter), mass length / time; nan: there is none, see reason.
    """
    momentum_lower: Floats
    """Derivative of the momentum exchanged at each impact, lower wall by the parameter, shape
    (Omega, constraint, parameter), mass length / time; nan: there is none, see reason.
    """
    shape: Floats
    """Derivative of the displacement at tau = 1 by the parameter, shape (Omega, dof,
    parameter), length; nan: there is none, see reason.
    """
    waveform: Floats
    """Derivative of the displacement by the parameter, shape (Omega, tau, dof, parameter),
    length; nan: there is none, see reason.
    """
    energy: Floats
    """Derivative of the total energy by the parameter, shape (Omega, parameter), mass length²
    / time²; nan: there is none, see reason.
    """
    harmonics: Floats
    """Derivative of the Fourier amplitude by the parameter, shape (Omega, harmonic, dof,
    parameter), length; nan: there is none, see reason.
    """


class ExistenceBandsBands(Table):
    """A range of frequency in which solutions are admissible."""

    start: Floats
    """Lower edge of a band, Omega, shape (bands_index), 1/time."""
    stop: Floats
    """Upper edge of a band, Omega, shape (bands_index), 1/time."""
    start_reason: Words
    """Why solutions below are phantoms, or range at the end of the requested range, shape
    (bands_index).
    """
    stop_reason: Words
    """The same of solutions above, shape (bands_index)."""
    edge_error: Floats
    """Largest absolute error of the edges, shape (bands_index), 1/time."""
    certified: Words
    """Whether existence is proved throughout, shape (bands_index)."""


class ExistenceBandsRejected(Table):
    """A range whose solutions are phantoms though all impulses are positive."""

    start: Floats
    """Lower edge of a rejected range, Omega, shape (rejected_index), 1/time."""
    stop: Floats
    """Upper edge of a rejected range, Omega, shape (rejected_index), 1/time."""
    reason: Words
    """Why its solutions are phantoms, shape (rejected_index)."""
    edge_error: Floats
    """Largest absolute error of the edges, shape (rejected_index), 1/time."""
    certified: Words
    """Whether that is proved throughout, shape (rejected_index)."""
    witness: Floats
    """Triangle-wave time at which a limit is passed, somewhere in the range, shape
    (rejected_index); nan: unknown.
    """
    constraint: Integers
    """Constraint whose limit is passed, -1 where unknown, shape (rejected_index)."""


class ExistenceBandsStability(Table):
    """A range inside a band, of stable or of unstable solutions."""

    start: Floats
    """Lower edge of a range, Omega, shape (stability_index), 1/time."""
    stop: Floats
    """Upper edge of a range, Omega, shape (stability_index), 1/time."""
    stable: Words
    """Whether deviations from its solutions do not grow; nor do they decay, shape
    (stability_index).
    """
    radius: Floats
    """Largest spectral radius of the half-period map at the frequencies examined, shape
    (stability_index).
    """


class ExistenceBandsUnresolved(Table):
    """A range that could not be decided; there are few."""

    start: Floats
    """Lower edge of an undecided range, Omega, shape (unresolved_index), 1/time."""
    stop: Floats
    """Upper edge of an undecided range, Omega, shape (unresolved_index), 1/time."""


class ExistenceBandsErrorBands(Table):
    """Absolute errors of the edges of bands."""

    start: Floats
    """Error of the lower edge, shape (bands_index), 1/time."""
    stop: Floats
    """Error of the upper edge, shape (bands_index), 1/time."""


class ExistenceBandsErrorRejected(Table):
    """Absolute errors of the edges."""

    start: Floats
    """Error of the lower edge, shape (rejected_index), 1/time."""
    stop: Floats
    """Error of the upper edge, shape (rejected_index), 1/time."""


class ExistenceBandsErrorStability(Table):
    """Absolute errors of edges and radii."""

    start: Floats
    """Error of the lower edge, shape (stability_index), 1/time."""
    stop: Floats
    """Error of the upper edge, shape (stability_index), 1/time."""
    radius: Floats
    """Error of the largest radius, shape (stability_index); nan: unbounded."""


class ExistenceBandsError(Table):
    """Errors of the bands."""

    PARTS: ClassVar[dict[str, type[Table]]] = {
        "bands": ExistenceBandsErrorBands,
        "rejected": ExistenceBandsErrorRejected,
        "stability": ExistenceBandsErrorStability,
    }
    resolution: float
    """Relative width below which a band or a gap between bands could be missed."""
    complete: bool
    """Whether all bands wider than that are proved to be listed."""
    unresolved: float
    """Fraction of the range that was not examined or could not be decided."""
    statement: str
    """How the errors were obtained."""
    bands: ExistenceBandsErrorBands
    """Absolute errors of the edges of bands."""
    rejected: ExistenceBandsErrorRejected
    """Absolute errors of the edges."""
    stability: ExistenceBandsErrorStability
    """Absolute errors of edges and radii."""


class ResonancesError(Table):
    """Errors of the natural frequencies."""

    statement: str
    """How the errors were obtained."""
    natural: Floats
    """Absolute error of the natural frequency, shape (resonance), 1/time."""
    relative: Floats
    """Relative error of the natural frequency, shape (resonance)."""
    Omega: Floats
    """Absolute error of Omega, shape (resonance), 1/time."""
    within_tolerance: Words
    """Whether the relative error is within the requested tolerance, shape (resonance)."""


class PeriodicMotionsFrequency(Table):
    """Frequencies of the drive."""

    Omega: Floats
    """Frequency of the drive, shape (Omega), 1/time."""
    complete: Words
    """Whether no motion with these impacts can be missing, shape (Omega)."""


class PeriodicMotionsSolution(Table):
    """One row for each periodic motion, admissible or phantom."""

    frequency_index: Integers
    """Index of the frequency, shape (solution_index)."""
    Omega: Floats
    """Frequency of the drive, shape (solution_index), 1/time."""
    impacts: Integers
    """Impacts per period, 0 of the motion without any, shape (solution_index)."""
    contacts: Integers
    """Contact phases per period, of stops of finite stiffness, shape (solution_index)."""
    exists: Booleans
    """Whether the solution is admissible, shape (solution_index)."""
    reason: Words
    """Why it is not admissible, or ok, shape (solution_index)."""
    witness: Floats
    """Part of the period, from the drive's phase 0, at which it fails, shape (solution_index);
    nan: none.
    """
    witness_constraint: Integers
    """Constraint at which it fails, or -1, shape (solution_index)."""
    certified: Words
    """Whether the verdict holds for all motions within the error, shape (solution_index)."""
    stability: Floats
    """Largest modulus of the multipliers over one period, shape (solution_index); nan:
    grazing.
    """
    neutral: Words
    """Whether that is 1 within its error: neither stable nor unstable, as far as is known,
    shape (solution_index).
    """
    bifurcation: Words
    """How the largest multiplier leaves the unit circle: through 1, a fold or the loss of
    symmetry, through -1, a flip, or as a complex pair, a torus; none where it does not, shape
    (solution_index).
    """
    x_max: Floats
    """Largest displacement, shape (solution_index, dof), length; nan: the load drives a mode
    without damping at its own frequency.
    """
    x_min: Floats
    """Smallest displacement, shape (solution_index, dof), length; nan: the load drives a mode
    without damping at its own frequency.
    """
    rms: Floats
    """Root mean square of the displacement, shape (solution_index, dof), length; nan: the load
    drives a mode without damping at its own frequency.
    """
    energy_lost: Floats
    """Energy lost by damping and impacts per period, shape (solution_index), mass length² /
    time²; nan: the load drives a mode without damping at its own frequency.
    """
    energy: Floats
    """Energy after the first impact, from the equilibrium under the constant load; without
    impacts at phase 0, shape (solution_index), mass length² / time²; nan: the load drives a
    mode without damping at its own frequency.
    """
    work: Floats
    """Work of the load per period, shape (solution_index), mass length² / time²; nan: the load
    drives a mode without damping at its own frequency.
    """
    within_tolerance: Words
    """Whether the errors of its impulses are within the tolerance, shape (solution_index)."""


class PeriodicMotionsImpact(Table):
    """One row for each impact of the solutions."""

    solution: Integers
    """Row of its solution, shape (impact_index)."""
    constraint: Integers
    """Index of the constraint struck, shape (impact_index)."""
    side: Integers
    """Wall: 1 the upper, -1 the lower one, shape (impact_index)."""
    phase: Floats
    """Phase of the drive, Omega t modulo 2 pi, shape (impact_index)."""
    time: Floats
    """Time in the period of the motion, from the drive's phase 0, shape (impact_index), time."""
    momentum: Floats
    """Momentum exchanged, positive where the wall pushes, shape (impact_index), mass length /
    time.
    """
    velocity: Floats
    """Velocity of the coordinate before the impact, shape (impact_index), length / time."""


class PeriodicMotionsContact(Table):
    """One row for each contact phase of the solutions with stops of finite stiffness."""

    solution: Integers
    """Row of its solution, shape (contact_index)."""
    constraint: Integers
    """Index of the constraint, shape (contact_index)."""
    side: Integers
    """Wall: 1 the upper, -1 the lower one, shape (contact_index)."""
    phase: Floats
    """Phase of the drive at its beginning, Omega t modulo 2 pi, shape (contact_index); 0 where
    the stop is loaded throughout.
    """
    time: Floats
    """Time of its beginning in the period of the motion, from phase 0, shape (contact_index),
    time.
    """
    duration: Floats
    """How long the stop pushes, shape (contact_index), time; the period where it is loaded
    throughout.
    """
    impulse: Floats
    """Integral of the force of the stop, shape (contact_index), mass length / time; nan: the
    load drives a mode without damping at its own frequency.
    """
    peak_force: Floats
    """Largest force of the stop, shape (contact_index), mass length / time²; nan: the load
    drives a mode without damping at its own frequency.
    """
    velocity: Floats
    """Velocity of the coordinate at its beginning, shape (contact_index), length / time; nan:
    the stop is loaded throughout.
    """
    indentation: Floats
    """Largest distance beyond the wall, shape (contact_index), length; nan: the load drives a
    mode without damping at its own frequency.
    """
    start_indentation: Floats
    """Distance beyond the wall at its beginning, shape (contact_index), length; positive where
    a stop with damping pushes again before its wall is left; nan: the stop is loaded
    throughout.
    """
    energy_lost: Floats
    """Energy that the contact loses, shape (contact_index), mass length² / time²; nan: the
    load drives a mode without damping at its own frequency.
    """


class PeriodicMotionsMultipliers(Table):
    """Floquet multipliers, by descending modulus; of conjugate ones the one above first."""

    real: Floats
    """Real part, shape (solution_index, multiplier); nan: grazing."""
    imaginary: Floats
    """Imaginary part, shape (solution_index, multiplier); nan: grazing."""


class PeriodicMotionsErrorSolution(Table):
    """Absolute errors of columns of the solutions."""

    stability: Floats
    """Error of the largest modulus, shape (solution_index); nan: there is no number."""
    x_max: Floats
    """Error of the largest displacement, shape (solution_index, dof), length; nan: there is no
    number.
    """
    x_min: Floats
    """Error of the smallest displacement, shape (solution_index, dof), length; nan: there is
    no number.
    """
    rms: Floats
    """Error of the root mean square, shape (solution_index, dof), length; nan: there is no
    number.
    """
    energy_lost: Floats
    """Error of the energy lost, shape (solution_index), mass length² / time²; nan: there is no
    number.
    """
    energy: Floats
    """Error of the energy, shape (solution_index), mass length² / time²; nan: there is no
    number.
    """
    work: Floats
    """Error of the work, shape (solution_index), mass length² / time²; nan: there is no
    number.
    """


class PeriodicMotionsErrorMultipliers(Table):
    """Absolute errors of the multipliers."""

    real: Floats
    """Error of the multiplier, and so of its real part, shape (solution_index, multiplier);
    nan: there is no number.
    """
    imaginary: Floats
    """Error of the same, of its imaginary part, shape (solution_index, multiplier); nan: there
    is no number.
    """


class PeriodicMotionsErrorImpact(Table):
    """Absolute errors of columns of the impacts."""

    phase: Floats
    """Error of the phase, shape (impact_index)."""
    time: Floats
    """Error of the time in the period, shape (impact_index), time."""
    momentum: Floats
    """Error of the momentum, shape (impact_index), mass length / time."""
    velocity: Floats
    """Error of the velocity, shape (impact_index), length / time."""


class PeriodicMotionsErrorContact(Table):
    """Absolute errors of columns of the contact phases."""

    phase: Floats
    """Error of the phase, shape (contact_index); nan: there is no number."""
    time: Floats
    """Error of the time in the period, shape (contact_index), time; nan: there is no number."""
    duration: Floats
    """Error of the duration, shape (contact_index), time; nan: there is no number."""
    impulse: Floats
    """Error of the impulse, shape (contact_index), mass length / time; nan: there is no
    number.
    """
    peak_force: Floats
    """Error of the largest force, shape (contact_index), mass length / time²; nan: there is no
    number.
    """
    velocity: Floats
    """Error of the velocity, shape (contact_index), length / time; nan: there is no number."""
    indentation: Floats
    """Error of the indentation, shape (contact_index), length; nan: there is no number."""
    start_indentation: Floats
    """Error of the distance beyond the wall at the beginning, shape (contact_index), length;
    nan: there is no number.
    """
    energy_lost: Floats
    """Error of the energy lost, shape (contact_index), mass length² / time²; nan: there is no
    number.
    """


class PeriodicMotionsError(Table):
    """Absolute errors of the outputs."""

    PARTS: ClassVar[dict[str, type[Table]]] = {
        "solution": PeriodicMotionsErrorSolution,
        "multipliers": PeriodicMotionsErrorMultipliers,
        "impact": PeriodicMotionsErrorImpact,
        "contact": PeriodicMotionsErrorContact,
    }
    statement: str
    """How the errors were obtained."""
    waveform: Floats
    """Error of the displacement at all times, shape (solution_index, one, dof), length; nan:
    there is no number.
    """
    solution: PeriodicMotionsErrorSolution
    """Absolute errors of columns of the solutions."""
    multipliers: PeriodicMotionsErrorMultipliers
    """Absolute errors of the multipliers."""
    impact: PeriodicMotionsErrorImpact
    """Absolute errors of columns of the impacts."""
    contact: PeriodicMotionsErrorContact
    """Absolute errors of columns of the contact phases."""


class BranchesSolution(PeriodicMotionsSolution):
    """One row for each periodic motion, admissible or phantom."""

    branch: Integers
    """Index of the branch, shape (solution_index)."""
    parameter: Floats
    """Value of the parameter, shape (solution_index)."""
    periods: Integers
    """Periods of the drive in one, shape (solution_index)."""


class BranchesErrorPoints(Table):
    """Absolute errors of the special points."""

    parameter: Floats
    """Absolute error of the parameter, shape (point)."""
    along: Floats
    """Absolute error of that place, shape (point)."""


class BranchesError(Table):
    """Absolute errors of the outputs."""

    PARTS: ClassVar[dict[str, type[Table]]] = {
        "solution": PeriodicMotionsErrorSolution,
        "multipliers": PeriodicMotionsErrorMultipliers,
        "impact": PeriodicMotionsErrorImpact,
        "contact": PeriodicMotionsErrorContact,
        "points": BranchesErrorPoints,
    }
    statement: str
    """How the errors were obtained."""
    waveform: Floats
    """Error of the displacement at all times, shape (solution_index, one, dof), length; nan:
    there is no number.
    """
    solution: PeriodicMotionsErrorSolution
    """Absolute errors of columns of the solutions."""
    multipliers: PeriodicMotionsErrorMultipliers
    """Absolute errors of the multipliers."""
    impact: PeriodicMotionsErrorImpact
    """Absolute errors of columns of the impacts."""
    contact: PeriodicMotionsErrorContact
    """Absolute errors of columns of the contact phases."""
    points: BranchesErrorPoints
    """Absolute errors of the special points."""


class BranchesPoints(Table):
    """A point of a branch at which its motions change."""

    branch: Integers
    """Index of the branch, shape (point)."""
    parameter: Floats
    """Value of the parameter, shape (point)."""
    type: Words
    """What happens: the branch turns (fold), period doubling (flip), two frequencies (torus),
    loss of symmetry, an impact without velocity, a first touch without any impact or a contact
    that begins or ends to be (grazing), or a limit that begins to be passed (end), shape
    (point).
    """
    Omega: Floats
    """Frequency of the drive, shape (point), 1/time."""
    exists: Booleans
    """Whether motions on one side of it are admissible, shape (point)."""
    leads_to: Integers
    """Branch that begins there and was followed, or -1, shape (point)."""
    solution: Integers
    """Row of the motion before it on its branch, shape (point)."""
    along: Floats
    """How far it lies on the way from that motion to the next one, 0 to 1, shape (point)."""
    error: Floats
    """Absolute error of the parameter, shape (point)."""


class AttractorsAttractor(Table):
    """One row for each attractor; all undecided motions are one row."""

    nature: Words
    """What it is, as far as is decided, shape (attractor_index)."""
    period: Integers
    """Period in periods of the drive, 0 of no periodic one, shape (attractor_index)."""
    impacts: Integers
    """Impacts in one period of a periodic one, else 0, shape (attractor_index)."""
    impact_rate: Floats
    """Mean number of impacts per period of the drive, shape (attractor_index)."""
    contacts: Integers
    """Contact phases in one period of a periodic one, else 0, shape (attractor_index); of
    stops of finite stiffness.
    """
    contact_rate: Floats
    """Mean number of contact phases per period of the drive, shape (attractor_index); of stops
    of finite stiffness.
    """
    rests: Words
    """Whether it rests at walls for a while, shape (attractor_index)."""
    exponent: Floats
    """Largest Lyapunov exponent, shape (attractor_index), 1/time; nan: it rests at a wall, or
    the attractor is undecided.
    """
    motions: Integers
    """Number of motions that settle on it, shape (attractor_index)."""
    fraction: Floats
    """Part of the motions that settle on it, shape (attractor_index)."""
    fraction_low: Floats
    """Lower end of the interval of 95 % of the fraction, shape (attractor_index)."""
    fraction_high: Floats
    """Upper end of the interval of 95 % of the fraction, shape (attractor_index)."""
    x: Floats
    """Displacement at the drive's phase 0, shape (attractor_index, dof), length."""
    v: Floats
    """Velocity at the drive's phase 0, shape (attractor_index, dof), length / time."""
    verification: Words
    """Whether Newton's method confirms a periodic one, or why not, shape (attractor_index)."""
    stability: Floats
    """Largest modulus of the multipliers over one period, shape (attractor_index); nan: not
    confirmed.
    """
    neutral: Words
    """Whether that is 1 within its error: neither stable nor unstable, as far as is known,
    shape (attractor_index).
    """


class AttractorsImpact(Table):
    """The impacts of one period of periodic attractors."""

    attractor: Integers
    """Row of its attractor, shape (impact_index)."""
    constraint: Integers
    """Index of the constraint struck, shape (impact_index)."""
    side: Integers
    """Wall: 1 the upper, -1 the lower one, shape (impact_index)."""
    phase: Floats
    """Phase of the drive, Omega t modulo 2 pi, shape (impact_index)."""
    time: Floats
    """Time in the period of the attractor, which begins with x and v, shape (impact_index),
    time.
    """
    momentum: Floats
    """Magnitude of the momentum exchanged, shape (impact_index), mass length / time."""
    velocity: Floats
    """Velocity of the coordinate before the impact, shape (impact_index), length / time."""


class AttractorsContact(Table):
    """The contact phases of one period of periodic attractors, with stops of finite stiffness."""

    attractor: Integers
    """Row of its attractor, shape (contact_index)."""
    constraint: Integers
    """Index of the constraint, shape (contact_index)."""
    side: Integers
    """Wall: 1 the upper, -1 the lower one, shape (contact_index)."""
    phase: Floats
    """Phase of the drive at its beginning, Omega t modulo 2 pi, shape (contact_index); 0 where
    the stop is loaded throughout.
    """
    time: Floats
    """Time of its beginning in the period of the attractor, which begins with x and v, shape
    (contact_index), time.
    """
    duration: Floats
    """How long the stop pushes, shape (contact_index), time; the period where it is loaded
    throughout.
    """
    impulse: Floats
    """Integral of the force of the stop, shape (contact_index), mass length / time."""
    peak_force: Floats
    """Largest force of the stop, shape (contact_index), mass length / time²."""
    velocity: Floats
    """Velocity of the coordinate at its beginning, shape (contact_index), length / time; nan:
    the stop is loaded throughout.
    """
    indentation: Floats
    """Largest distance beyond the wall, shape (contact_index), length."""
    start_indentation: Floats
    """Distance beyond the wall at its beginning, shape (contact_index), length; positive where
    a stop with damping pushes again before its wall is left; nan: not confirmed, or the stop is
    loaded throughout.
    """
    energy_lost: Floats
    """Energy that the contact loses, shape (contact_index), mass length² / time²."""


class AttractorsSection(Table):
    """Points of the sections of attractors."""

    attractor: Integers
    """Row of its attractor, shape (section_index)."""
    x: Floats
    """Displacement at the drive's phase 0, shape (section_index, dof), length."""
    v: Floats
    """Velocity at the drive's phase 0, shape (section_index, dof), length / time."""
    constraint: Integers
    """Index of the constraint struck, shape (section_index)."""
    side: Integers
    """Wall: 1 the upper, -1 the lower one, shape (section_index)."""
    phase: Floats
    """Phase of the drive, Omega t modulo 2 pi, shape (section_index)."""
    velocity: Floats
    """Velocity of the coordinate before the impact, shape (section_index), length / time."""


class AttractorsSettled(Table):
    """What each motion settles on."""

    status: Words
    """Whether there is a motion, or why not, shape (motion)."""
    attractor: Integers
    """Row of its attractor, -1 where it has none, shape (motion)."""
    period: Integers
    """Period in periods of the drive, 0 of no periodic one, shape (motion)."""
    exponent: Floats
    """Largest Lyapunov exponent, shape (motion), 1/time; nan: it rests at a wall, or there is
    no motion.
    """


class AttractorsErrorAttractor(Table):
    """Errors of columns of the attractors."""

    exponent: Floats
    """Error of the largest Lyapunov exponent, shape (attractor_index), 1/time; nan: none."""
    impact_rate: Floats
    """Error of the mean number of impacts, shape (attractor_index)."""
    contact_rate: Floats
    """Error of the mean number of contact phases, shape (attractor_index)."""
    fraction: Floats
    """Error of the fraction, shape (attractor_index)."""
    x: Floats
    """Error of the displacement, shape (attractor_index, dof), length; nan: not periodic."""
    v: Floats
    """Error of the velocity, shape (attractor_index, dof), length / time; nan: not periodic."""
    stability: Floats
    """Error of the largest modulus, shape (attractor_index); nan: none."""


class AttractorsErrorSection(Table):
    """Errors of points of sections."""

    x: Floats
    """Error of the displacement, shape (section_index, dof), length; nan: not periodic."""
    v: Floats
    """Error of the velocity, shape (section_index, dof), length / time; nan: not periodic."""
    phase: Floats
    """Error of the phase, shape (section_index); nan: not periodic."""
    velocity: Floats
    """Error of the velocity, shape (section_index), length / time; nan: not periodic."""


class AttractorsErrorImpact(Table):
    """Errors of columns of the impacts."""

    phase: Floats
    """Error of the phase, shape (impact_index); nan: not confirmed."""
    time: Floats
    """Error of the time, shape (impact_index), time; nan: not confirmed."""
    momentum: Floats
    """Error of the momentum, shape (impact_index), mass length / time; nan: not confirmed."""
    velocity: Floats
    """Error of the velocity, shape (impact_index), length / time; nan: not confirmed."""


class AttractorsErrorContact(Table):
    """Errors of columns of the contact phases."""

    phase: Floats
    """Error of the phase, shape (contact_index); nan: not confirmed."""
    time: Floats
    """Error of the time, shape (contact_index), time; nan: not confirmed."""
    duration: Floats
    """Error of the duration, shape (contact_index), time; nan: not confirmed."""
    impulse: Floats
    """Error of the impulse, shape (contact_index), mass length / time; nan: not confirmed."""
    peak_force: Floats
    """Error of the force, shape (contact_index), mass length / time²; nan: not confirmed."""
    velocity: Floats
    """Error of the velocity, shape (contact_index), length / time; nan: not confirmed."""
    indentation: Floats
    """Error of the indentation, shape (contact_index), length; nan: not confirmed."""
    start_indentation: Floats
    """Error of the indentation, shape (contact_index), length; nan: not confirmed."""
    energy_lost: Floats
    """Error of the energy, shape (contact_index), mass length² / time²; nan: not confirmed."""


class AttractorsErrorSettled(Table):
    """Errors of columns of the motions."""

    exponent: Floats
    """Error of the largest Lyapunov exponent, shape (motion), 1/time; nan: none."""


class AttractorsError(Table):
    """Errors of the outputs."""

    PARTS: ClassVar[dict[str, type[Table]]] = {
        "attractor": AttractorsErrorAttractor,
        "section": AttractorsErrorSection,
        "impact": AttractorsErrorImpact,
        "contact": AttractorsErrorContact,
        "settled": AttractorsErrorSettled,
    }
    statement: str
    """How the errors were obtained."""
    failures: str
    """Why there are no motions, the first of them."""
    undecided: str
    """Why motions are undecided, the first of them, and what to ask for."""
    attractor: AttractorsErrorAttractor
    """Errors of columns of the attractors."""
    section: AttractorsErrorSection
    """Errors of points of sections."""
    impact: AttractorsErrorImpact
    """Errors of columns of the impacts."""
    contact: AttractorsErrorContact
    """Errors of columns of the contact phases."""
    settled: AttractorsErrorSettled
    """Errors of columns of the motions."""


class TimeHistoryImpacts(Table):
    """All impacts in order, one column each."""

    time: Floats
    """Time of the impact, shape (impact), time."""
    constraint: Integers
    """Index of the constraint, shape (impact)."""
    side: Integers
    """Wall: 1 the upper, -1 the lower one, shape (impact)."""
    velocity: Floats
    """Velocity of the coordinate before the impact, shape (impact), length / time."""
    impulse: Floats
    """Impulse on the structure, shape (impact), mass length / time."""
    condition: Floats
    """Estimated relative error of the state, in units of the rounding 2^-52, shape (impact);
    nan: not estimated.
    """
    law: Words
    """Law that the impulse follows, shape (impact); newton: no other coordinate at its wall is
    coupled to it; of several at once poisson, or moreau where the restitution of all of them is
    1.
    """


class TimeHistoryContacts(Table):
    """Times at which coordinates rest at rigid walls, or stops push: one column each."""

    start: Floats
    """Time at which the contact begins, shape (contact), time; of a rigid stop the last impact
    listed before it: the infinitely many impacts from it to the rest are summed; of another one
    the time at which it begins to push.
    """
    rest: Floats
    """Time at which the coordinate comes to rest, shape (contact), time; of a stop of finite
    stiffness the start.
    """
    stop: Floats
    """Time of release, or the end of the motion, shape (contact), time; of a stop of finite
    stiffness the time at which its force is zero.
    """
    constraint: Integers
    """Index of the constraint, shape (contact)."""
    side: Integers
    """Wall: 1 the upper, -1 the lower one, shape (contact)."""
    velocity: Floats
    """Velocity of the coordinate at the start, shape (contact), length / time; of stops of
    finite stiffness; away from the wall where a dashpot pushes again before the wall is left.
    """
    impulse: Floats
    """Impulse of the wall on the structure, rest to stop, shape (contact), mass length / time;
    the integral of the contact force.
    """
    peak_force: Floats
    """Largest force, shape (contact), mass length / time²; of stops of finite stiffness."""
    indentation: Floats
    """Largest distance of the coordinate beyond its wall, shape (contact), length; of stops of
    finite stiffness.
    """
    energy_lost: Floats
    """Energy lost in the stop, shape (contact), mass length² / time²; in its dashpot, and by
    what its spring still holds when the force is zero.
    """


class TimeHistoryCount(Table):
    """Numbers of events."""

    impacts: int
    """Number of impacts, without those summed in a chatter."""
    grazings: int
    """Number of touches of a wall without an impulse."""
    expansions: int
    """Number of series expansions in the search for impacts."""


class TimeHistoryErrorImpacts(Table):
    """Errors of columns of the impacts."""

    time: Floats
    """Error of the time of the impact, shape (impact), time; nan: not estimated, or beyond the
    horizon, or the impact may be missing.
    """
    velocity: Floats
    """Error of the velocity before it, shape (impact), length / time; nan: not estimated, or
    beyond the horizon.
    """
    impulse: Floats
    """Error of the impulse, shape (impact), mass length / time; nan: not estimated, or beyond
    the horizon.
    """


class TimeHistoryErrorContacts(Table):
    """Errors of columns of the contacts."""

    start: Floats
    """Error of the last impact, shape (contact), time; nan: not estimated, or beyond the
    horizon, or the impact may be missing.
    """
    rest: Floats
    """Error of the time of rest, shape (contact), time; nan: not estimated, or beyond the
    horizon, or the impact may be missing.
    """
    stop: Floats
    """Error of the time of release, shape (contact), time; nan: not estimated, or beyond the
    horizon, or the impact may be missing.
    """
    velocity: Floats
    """Error of the velocity, shape (contact), length / time; nan: not estimated, or beyond the
    horizon, or the impact may be missing.
    """
    impulse: Floats
    """Error of the impulse, shape (contact), mass length / time; nan: not estimated, or beyond
    the horizon, or the impact may be missing.
    """
    peak_force: Floats
    """Error of the force, shape (contact), mass length / time²; nan: not estimated, or beyond
    the horizon, or the impact may be missing.
    """
    indentation: Floats
    """Error of the indentation, shape (contact), length; nan: not estimated, or beyond the
    horizon, or the impact may be missing.
    """
    energy_lost: Floats
    """Error of the energy, shape (contact), mass length² / time²; nan: not estimated, or
    beyond the horizon, or the impact may be missing.
    """


class TimeHistoryErrorDerivativeImpacts(Table):
    """Absolute errors of these derivatives."""

    time: Floats
    """Error of the derivative of the time of the impact, shape (impact, parameter), time; nan:
    unbounded, or there is no derivative.
    """
    velocity: Floats
    """Error of the derivative of the velocity before the impact, shape (impact, parameter),
    length / time; nan: unbounded, or there is no derivative.
    """
    impulse: Floats
    """Error of the derivative of the impulse, shape (impact, parameter), mass length / time;
    nan: unbounded, or there is no derivative.
    """


class TimeHistoryErrorDerivative(Table):
    """Absolute errors of the derivatives."""

    PARTS: ClassVar[dict[str, type[Table]]] = {"impacts": TimeHistoryErrorDerivativeImpacts}
    x: Floats
    """Error of the derivative of the displacement, shape (t, dof, parameter), length; nan:
    unbounded, or there is no derivative.
    """
    v: Floats
    """Error of the derivative of the velocity, shape (t, dof, parameter), length / time; nan:
    unbounded, or there is no derivative.
    """
    a: Floats
    """Error of the derivative of the acceleration, shape (t, dof, parameter), length / time²;
    nan: unbounded, or there is no derivative.
    """
    energy: Floats
    """Error of the derivative of the energy, shape (t, parameter), mass length² / time²; nan:
    unbounded, or there is no derivative.
    """
    impacts: TimeHistoryErrorDerivativeImpacts
    """Absolute errors of these derivatives."""


class TimeHistoryError(Table):
    """Errors of the motion."""

    PARTS: ClassVar[dict[str, type[Table]]] = {
        "impacts": TimeHistoryErrorImpacts,
        "contacts": TimeHistoryErrorContacts,
        "derivative": TimeHistoryErrorDerivative,
    }
    x: Floats
    """Error of the displacement, shape (t, dof), length; nan: not estimated, or beyond the
    horizon.
    """
    v: Floats
    """Error of the velocity, shape (t, dof), length / time; nan: not estimated, or beyond the
    horizon.
    """
    a: Floats
    """Error of the acceleration, shape (t, dof), length / time²; nan: not estimated, or beyond
    the horizon.
    """
    energy: Floats
    """Error of the energy, shape (t), mass length² / time²; nan: not estimated, or beyond the
    horizon.
    """
    force: Floats
    """Error of the force, shape (t, constraint), mass length / time²; nan: not estimated, or
    beyond the horizon.
    """
    condition: float
    """Largest relative error of the state, in units of the rounding 2^-52."""
    penetration: float
    """Largest distance between a wall and the place of an impact at it, length."""
    predictable_until: float
    """Time until which the tolerance can hold with the digits of the computation, at most the
    end of the motion, time.
    """
    tolerance: float
    """Tolerance on the error of the state, relative to it."""
    energy_drift: float
    """Largest relative change of the energy; absent where loads or losses change it, or it was
    not requested.
    """
    difference: float
    """Largest difference to a run of Taylor steps 32 times less accurate, whose initial state,
    frequencies and limiters are off by their roundings, relative to the largest state; absent
    where no Taylor steps are taken.
    """
    statement: str
    """How the errors were obtained."""
    digits: int
    """Decimal digits of the arithmetic; absent for double precision."""
    impacts: TimeHistoryErrorImpacts
    """Errors of columns of the impacts."""
    contacts: TimeHistoryErrorContacts
    """Errors of columns of the contacts."""
    derivative: TimeHistoryErrorDerivative
    """Absolute errors of the derivatives."""


class TimeHistoryDerivativeImpacts(Table):
    """Derivatives of columns of the impacts by the parameters."""

    reason: Words
    """Why there is no derivative, or ok, shape (impact)."""
    time: Floats
    """Derivative of the time of the impact by the parameter, shape (impact, parameter), time;
    nan: there is none, see reason.
    """
    velocity: Floats
    """Derivative of the velocity before the impact by the parameter, shape (impact,
    parameter), length / time; nan: there is none, see reason.
    """
    impulse: Floats
    """Derivative of the impulse by the parameter, shape (impact, parameter), mass length /
    time; nan: there is none, see reason.
    """


class TimeHistoryDerivative(Derivatives):
    """Derivatives of the outputs by the parameters, per unit of the parameter."""

    PARTS: ClassVar[dict[str, type[Table]]] = {"impacts": TimeHistoryDerivativeImpacts}
    parameter: Words
    """Path of the parameter of the derivatives, shape (parameter)."""
    unit: Words
    """Unit of the parameter, by which those of the derivatives are divided, shape (parameter)."""
    reason: Words
    """Why there is no derivative, or ok, shape (t); event: an impact happens at this time;
    contact: a coordinate has come to rest; order: coupled coordinates strike at one instant;
    grazing: a wall is touched; unpredictable: beyond the horizon; start: the motion starts with
    an impact.
    """
    distance: Floats
    """Change of the parameter to where there is no derivative, to first order, shape
    (parameter); where the velocity of an impact is zero, or two coupled impacts meet; impacts
    that come into being are not looked for; nan: none is in sight.
    """
    x: Floats
    """Derivative of the displacement by the parameter, shape (t, dof, parameter), length; nan:
    there is none, see reason.
    """
    v: Floats
    """Derivative of the velocity by the parameter, shape (t, dof, parameter), length / time;
    nan: there is none, see reason.
    """
    a: Floats
    """Derivative of the acceleration by the parameter, shape (t, dof, parameter), length /
    time²; nan: there is none, see reason.
    """
    energy: Floats
    """Derivative of the energy by the parameter, shape (t, parameter), mass length² / time²;
    nan: there is none, see reason.
    """
    impacts: TimeHistoryDerivativeImpacts
    """Derivatives of columns of the impacts by the parameters."""


class EnsembleCount(Table):
    """Numbers of events of each member."""

    impacts: Integers
    """Number of impacts, without those summed in a chatter, shape (member)."""
    grazings: Integers
    """Number of touches of a wall without an impulse, shape (member)."""
    expansions: Integers
    """Number of series expansions in the search for impacts, shape (member)."""


class EnsembleError(Table):
    """Errors of each motion; null where a member has none."""

    PARTS: ClassVar[dict[str, type[Table]]] = {
        "impacts": TimeHistoryErrorImpacts,
        "contacts": TimeHistoryErrorContacts,
    }
    x: Floats
    """Error of the displacement, shape (member, t, dof), length; nan: the member has no
    motion, beyond its horizon, or not estimated.
    """
    v: Floats
    """Error of the velocity, shape (member, t, dof), length / time; nan: the member has no
    motion, beyond its horizon, or not estimated.
    """
    a: Floats
    """Error of the acceleration, shape (member, t, dof), length / time²; nan: the member has
    no motion, beyond its horizon, or not estimated.
    """
    energy: Floats
    """Error of the energy, shape (member, t), mass length² / time²; nan: the member has no
    motion, beyond its horizon, or not estimated.
    """
    force: Floats
    """Error of the force, shape (member, t, constraint), mass length / time²; nan: the member
    has no motion, beyond its horizon, or not estimated.
    """
    condition: Floats
    """Largest relative error of the state, in units of the rounding 2^-52, shape (member);
    nan: the member has no motion.
    """
    penetration: Floats
    """Largest distance between a wall and the place of an impact at it, shape (member),
    length; nan: the member has no motion.
    """
    predictable_until: Floats
    """Time until which the tolerance can hold with the digits of the computation, at most the
    end of the motion, shape (member), time; nan: the member has no motion.
    """
    energy_drift: Floats
    """Largest relative change of the energy, shape (member); absent where loads or losses
    change it, or it was not requested; nan: the member has no motion.
    """
    difference: Floats
    """Largest difference to a run of Taylor steps 32 times less accurate, whose initial state,
    frequencies and limiters are off by their roundings, relative to the largest state, shape
    (member); absent where no Taylor steps are taken; nan: the member has no motion.
    """
    tolerance: float
    """Tolerance on the error of the state, relative to it."""
    statement: str
    """How the errors were obtained."""
    failures: str
    """Why members have no motion, the first of them."""
    impacts: TimeHistoryErrorImpacts
    """Errors of columns of the impacts."""
    contacts: TimeHistoryErrorContacts
    """Errors of columns of the contacts."""


class SlowFlowImpacts(Table):
    """The impacts of the exact motion."""

    time: Floats
    """Time of the exact impact, shape (impact), time."""
    velocity: Floats
    """Speed before the exact impact, shape (impact), length / time."""


class SlowFlowErrorImpacts(Table):
    """Errors of columns of the impacts."""

    time: Floats
    """Error of the time, shape (impact), time."""
    velocity: Floats
    """Error of the speed, shape (impact), length / time."""


class SlowFlowErrorDifference(Table):
    """Differences of this variant from the exact motion."""

    x: Floats
    """Displacement minus that of the exact motion, shape (t, dof), length."""
    gamma: Floats
    """Frequency ratio minus that of the exact motion, at its impacts, shape (impact); nan:
    after the variant's last impact.
    """
    phi: Floats
    """Phase minus that of the exact motion, at its impacts, shape (impact); nan: after the
    variant's last impact.
    """


class SlowFlowError(Table):
    """Absolute errors of the outputs of this variant, and times taken."""

    PARTS: ClassVar[dict[str, type[Table]]] = {
        "impacts": SlowFlowErrorImpacts,
        "difference": SlowFlowErrorDifference,
    }
    gamma: Floats
    """Error of the frequency ratio, shape (t); nan: after the last impact, or unknown."""
    omega: Floats
    """Error of the triangle-wave frequency, shape (t), 1/time; nan: after the last impact, or
    unknown.
    """
    phi: Floats
    """Error of the phase, shape (t); nan: after the last impact, or unknown."""
    A: Floats
    """Error of the sine amplitude, shape (t), length; nan: after the last impact, or unknown."""
    B: Floats
    """Error of the cosine amplitude, shape (t), length; nan: after the last impact, or
    unknown.
    """
    x: Floats
    """Error of the displacement, shape (t, dof), length."""
    v: Floats
    """Error of the velocity, shape (t, dof), length / time."""
    impulse: Floats
    """Error of the impulse parameter p, shape (t), mass length / time²; nan: after the last
    impact, or unknown.
    """
    momentum: Floats
    """Error of the momentum exchanged, shape (t), mass length / time; nan: after the last
    impact, or unknown.
    """
    t_max: Floats
    """Difference of the ends of the impacts, time; nan: one of them never ends."""
    t_max_exact: Floats
    """Error of the end of the exact impacts, time."""
    seconds: Floats
    """Computing time of this variant, s."""
    seconds_exact: Floats
    """Computing time of the exact motion, s."""
    within_tolerance: Words
    """Whether the largest error of the displacement, relative to the largest displacement, is
    within the requested tolerance.
    """
    statement: str
    """How the errors were obtained."""
    impacts: SlowFlowErrorImpacts
    """Errors of columns of the impacts."""
    difference: SlowFlowErrorDifference
    """Differences of this variant from the exact motion."""


class CalibrationMeasurements(Table):
    """All measured numbers, one column each."""

    data: Integers
    """Index of the entry of data, shape (measurement)."""
    index: Integers
    """Place in its values, row by row, shape (measurement)."""
    measured: Floats
    """Measured value, shape (measurement)."""
    sigma: Floats
    """Standard deviation of the noise, shape (measurement)."""
    computed: Floats
    """Value of the model at the best fit, shape (measurement); in the unit of the output; of
    an impact that the model lacks the end of the record, or the measured value.
    """


class CalibrationDirections(Table):
    """Principal axes of the covariance, the least known first, in parts of the values."""

    vector: Floats
    """Components, parts of the sizes of the unknowns, shape (direction, unknown)."""
    deviation: Floats
    """Standard deviation along it, in parts of the sizes of the unknowns, shape (direction);
    nan: the data does not tell it.
    """


class CalibrationStarts(Table):
    """Searches from each start, one column each."""

    initial: Floats
    """Values from which the search began, shape (start, unknown); in the units of the
    unknowns.
    """
    value: Floats
    """Values at which it ended, shape (start, unknown); in the units of the unknowns; nan:
    nothing can be computed at the start.
    """
    chi2: Floats
    """Chi2 at its end, shape (start); nan: nothing can be computed at the start."""
    evaluations: Integers
    """Evaluations of the model, shape (start)."""
    status: Words
    """How the search ended, shape (start)."""


class CalibrationCount(Table):
    """Numbers of computations."""

    evaluations: int
    """Computations of the base, those for differences included."""
    differences: int
    """Computations for differences alone."""
    unmatched: int
    """Impacts that the model has and the data has not, or the other way round, or frequencies
    at which the model has no stable motion, at the best fit.
    """


class CalibrationErrorMeasurements(Table):
    """Errors of columns of the measurements."""

    computed: Floats
    """Absolute error of the computed value, shape (measurement); nan: the motion is not
    predictable as long as the record.
    """


class CalibrationErrorDirections(Table):
    """Errors of columns of the directions."""

    vector: Floats
    """Absolute error of the components, shape (direction, unknown); nan: the direction cannot
    be told from its neighbours.
    """
    deviation: Floats
    """Absolute error of the standard deviation, shape (direction); nan: the data does not tell
    it.
    """


class CalibrationError(Table):
    """Numerical errors of the outputs."""

    PARTS: ClassVar[dict[str, type[Table]]] = {
        "measurements": CalibrationErrorMeasurements,
        "directions": CalibrationErrorDirections,
    }
    value: Floats
    """Absolute error of the value, without the noise of the data, shape (unknown); nan: the
    motion is not predictable as long as the record.
    """
    covariance: Floats
    """Absolute error of the covariance, shape (unknown, other); nan: the data does not tell
    it, or it is at a bound.
    """
    interval: Floats
    """Absolute error of the end, shape (unknown, end); nan: no end: the data does not bound
    it.
    """
    residual: Floats
    """Absolute error of the residual, shape (measurement); nan: the motion is not predictable
    as long as the record.
    """
    chi2: float
    """Absolute error of the chi2; nan: the motion is not predictable as long as the record."""
    p: float
    """Absolute error of the probability."""
    statement: str
    """How the errors were obtained."""
    measurements: CalibrationErrorMeasurements
    """Errors of columns of the measurements."""
    directions: CalibrationErrorDirections
    """Errors of columns of the directions."""


class NaturalFrequencies(Result):
    """Natural frequencies and mode shapes, ascending; shapes have unit modal mass."""

    PARTS: ClassVar[dict[str, type[Table]]] = {
        "error": NaturalFrequenciesError,
        "derivative": NaturalFrequenciesDerivative,
    }
    request: documents.NaturalFrequenciesRequest
    mode: Integers
    """Index of the mode, ascending, shape (mode)."""
    Omega: Floats
    """Natural angular frequency, shape (mode), 1/time; 0 of a rigid-body mode, minus the rate
    of growth of an unstable one.
    """
    shape: Floats
    """Mode shape, shape (mode, dof), 1/√mass; of unit modal mass, its largest entry positive."""
    participation: Floats
    """Constrained coordinate of the mode shape, shape (mode, constraint), 1/√mass."""
    effective_mass: Floats
    """Effective modal mass of a motion of the base, shape (mode, direction), mass."""
    residual_flexibility: Floats
    """Static flexibility of all modes that are left out, shape (constraint, other), time² /
    mass; of a free structure, of its elastic modes.
    """
    parameter: Words
    """Path of the parameter of the derivatives, shape (parameter)."""
    error: NaturalFrequenciesError
    """Absolute errors of the outputs."""
    derivative: NaturalFrequenciesDerivative
    """Derivatives of the outputs by the parameters, per unit of the parameter."""


class ImpactModes(Result):
    """Solutions of a family of impact modes; outputs that were not requested are absent.

    Where the equations are singular to the last bit, the impulse and all else is 0.
    """

    PARTS: ClassVar[dict[str, type[Table]]] = {
        "frequency": ImpactModesFrequency,
        "error": ImpactModesError,
        "derivative": ImpactModesDerivative,
    }
    request: documents.ImpactModesRequest
    Omega: Floats
    """Fundamental angular frequency, shape (Omega), 1/time."""
    omega: Floats
    """Triangle-wave frequency, shape (Omega), 1/time; (2/pi) Omega."""
    constraint: Integers
    """Index of the active constraint, shape (constraint)."""
    dof: Integers
    """Index of the degree of freedom, shape (dof)."""
    tau: Floats
    """Triangle-wave time, shape (tau)."""
    harmonic: Integers
    """Multiple of Omega, shape (harmonic)."""
    impulse: Floats
    """Impulse parameter p, upper wall, shape (Omega, constraint), mass length / time²; 0 where
    there is no such wall.
    """
    impulse_lower: Floats
    """Impulse parameter p, lower wall, shape (Omega, constraint), mass length / time²; absent
    where both walls are alike.
    """
    momentum: Floats
    """Momentum exchanged at each impact, upper wall, shape (Omega, constraint), mass length /
    time; 2 p/omega.
    """
    momentum_lower: Floats
    """Momentum exchanged at each impact, lower wall, shape (Omega, constraint), mass length /
    time; absent where both walls are alike.
    """
    exists: Booleans
    """Whether the solution is admissible, shape (Omega)."""
    reason: Words
    """Why the solution is a phantom, or ok, shape (Omega)."""
    certified: Words
    """Whether that is proved, errors included, shape (Omega)."""
    extended: Words
    """Whether ball arithmetic proved it, where double precision could not, shape (Omega)."""
    witness: Floats
    """Triangle-wave time at which a limit is passed, shape (Omega); nan: none is."""
    shape: Floats
    """Displacement at tau = 1, shape (Omega, dof), length."""
    waveform: Floats
    """Displacement, shape (Omega, tau, dof), length."""
    energy: Floats
    """Total energy, shape (Omega), mass length² / time²."""
    stability: Floats
    """Spectral radius of the half-period map, shape (Omega); nan: the order of simultaneous
    impacts decides, or the solution is a phantom.
    """
    neutral: Words
    """Whether the spectral radius is 1 within its error: deviations neither grow, as far as is
    known, nor decay, as nothing is lost, shape (Omega).
    """
    harmonics: Floats
    """Fourier amplitude, of sin(n Omega t) for odd and cos(n Omega t) for even multiples n,
    shape (Omega, harmonic, dof), length.
    """
    parameter: Words
    """Path of the parameter of the derivatives, shape (parameter)."""
    frequency: ImpactModesFrequency
    """The frequencies, as Omega and as omega."""
    error: ImpactModesError
    """Errors of the outputs."""
    derivative: ImpactModesDerivative
    """Derivatives of the outputs by the parameters, per unit of the parameter."""


class ExistenceBands(Result):
    """Bands of existence, ascending in Omega; outputs that were not requested are absent."""

    PARTS: ClassVar[dict[str, type[Table]]] = {
        "bands": ExistenceBandsBands,
        "rejected": ExistenceBandsRejected,
        "stability": ExistenceBandsStability,
        "unresolved": ExistenceBandsUnresolved,
        "error": ExistenceBandsError,
    }
    request: documents.ExistenceBandsRequest
    bands: ExistenceBandsBands
    """A range of frequency in which solutions are admissible."""
    rejected: ExistenceBandsRejected
    """A range whose solutions are phantoms though all impulses are positive."""
    stability: ExistenceBandsStability
    """A range inside a band, of stable or of unstable solutions."""
    unresolved: ExistenceBandsUnresolved
    """A range that could not be decided; there are few."""
    error: ExistenceBandsError
    """Errors of the bands."""


class Resonances(Result):
    """Internal resonances by ascending frequency."""

    PARTS: ClassVar[dict[str, type[Table]]] = {"error": ResonancesError}
    request: documents.ResonancesRequest
    Omega: Floats
    """Fundamental frequency of the impact mode, shape (resonance), 1/time."""
    harmonic: Integers
    """Odd multiple of Omega that resonates, shape (resonance)."""
    part: Integers
    """Part of the structure with the constrained coordinate held fixed, shape (resonance);
    parts are counted from the lowest degree of freedom.
    """
    natural: Floats
    """Natural frequency of the structure with the constrained coordinate held fixed, shape
    (resonance), 1/time.
    """
    error: ResonancesError
    """Errors of the natural frequencies."""


class PeriodicMotions(Result):
    """Solutions by ascending index of frequency; outputs that were not requested are absent."""

    PARTS: ClassVar[dict[str, type[Table]]] = {
        "frequency": PeriodicMotionsFrequency,
        "solution": PeriodicMotionsSolution,
        "impact": PeriodicMotionsImpact,
        "contact": PeriodicMotionsContact,
        "multipliers": PeriodicMotionsMultipliers,
        "error": PeriodicMotionsError,
    }
    request: documents.PeriodicMotionsRequest
    Omega: Floats
    """Frequency of the drive, shape (Omega), 1/time."""
    dof: Integers
    """Index of the degree of freedom, shape (dof)."""
    tau: Floats
    """Part of the period, from the drive's phase 0, shape (tau)."""
    waveform: Floats
    """Displacement, shape (solution_index, tau, dof), length; nan: the load drives a mode
    without damping at its own frequency.
    """
    frequency: PeriodicMotionsFrequency
    """Frequencies of the drive."""
    solution: PeriodicMotionsSolution
    """One row for each periodic motion, admissible or phantom."""
    impact: PeriodicMotionsImpact
    """One row for each impact of the solutions."""
    contact: PeriodicMotionsContact
    """One row for each contact phase of the solutions with stops of finite stiffness."""
    multipliers: PeriodicMotionsMultipliers
    """Floquet multipliers, by descending modulus; of conjugate ones the one above first."""
    error: PeriodicMotionsError
    """Absolute errors of the outputs."""


class Branches(Result):
    """Motions branch by branch, in their order along each; special points of all branches."""

    PARTS: ClassVar[dict[str, type[Table]]] = {
        "frequency": PeriodicMotionsFrequency,
        "solution": BranchesSolution,
        "impact": PeriodicMotionsImpact,
        "contact": PeriodicMotionsContact,
        "multipliers": PeriodicMotionsMultipliers,
        "error": BranchesError,
        "points": BranchesPoints,
    }
    request: documents.BranchesRequest
    Omega: Floats
    """Frequency of the drive, shape (Omega), 1/time."""
    dof: Integers
    """Index of the degree of freedom, shape (dof)."""
    tau: Floats
    """Part of the period, from the drive's phase 0, shape (tau)."""
    waveform: Floats
    """Displacement, shape (solution_index, tau, dof), length; nan: the load drives a mode
    without damping at its own frequency.
    """
    frequency: PeriodicMotionsFrequency
    """Frequencies of the drive."""
    solution: BranchesSolution
    """One row for each periodic motion, admissible or phantom."""
    impact: PeriodicMotionsImpact
    """One row for each impact of the solutions."""
    contact: PeriodicMotionsContact
    """One row for each contact phase of the solutions with stops of finite stiffness."""
    multipliers: PeriodicMotionsMultipliers
    """Floquet multipliers, by descending modulus; of conjugate ones the one above first."""
    error: BranchesError
    """Absolute errors of the outputs."""
    points: BranchesPoints
    """A point of a branch at which its motions change."""


class Attractors(Result):
    """Attractors in the order in which motions first settle on them; sections where requested."""

    PARTS: ClassVar[dict[str, type[Table]]] = {
        "attractor": AttractorsAttractor,
        "impact": AttractorsImpact,
        "contact": AttractorsContact,
        "section": AttractorsSection,
        "settled": AttractorsSettled,
        "error": AttractorsError,
    }
    NUMBERS: ClassVar[tuple[str, ...]] = ("Omega",)
    request: documents.AttractorsRequest
    Omega: float
    """Frequency of the drive, 1/time."""
    dof: Integers
    """Index of the degree of freedom, shape (dof)."""
    motion: Integers
    """Index of the initial state, shape (motion)."""
    attractor: AttractorsAttractor
    """One row for each attractor; all undecided motions are one row."""
    impact: AttractorsImpact
    """The impacts of one period of periodic attractors."""
    contact: AttractorsContact
    """The contact phases of one period of periodic attractors, with stops of finite stiffness."""
    section: AttractorsSection
    """Points of the sections of attractors."""
    settled: AttractorsSettled
    """What each motion settles on."""
    error: AttractorsError
    """Errors of the outputs."""


class TimeHistory(Motion):
    """A motion; outputs that were not requested are absent."""

    PARTS: ClassVar[dict[str, type[Table]]] = {
        "impacts": TimeHistoryImpacts,
        "contacts": TimeHistoryContacts,
        "count": TimeHistoryCount,
        "error": TimeHistoryError,
        "derivative": TimeHistoryDerivative,
    }
    request: documents.TimeHistoryRequest
    t: Floats
    """Time, shape (t), time."""
    dof: Integers
    """Index of the degree of freedom, shape (dof)."""
    x: Floats
    """Displacement, shape (t, dof), length."""
    v: Floats
    """Velocity, shape (t, dof), length / time."""
    a: Floats
    """Acceleration, shape (t, dof), length / time²; between impacts, without their impulses."""
    energy: Floats
    """Mechanical energy, that of the constant load and of compressed stops included, shape
    (t), mass length² / time².
    """
    force: Floats
    """Force between a stop and the structure, shape (t, constraint), mass length / time²; of
    stops of finite stiffness; it only pushes.
    """
    parameter: Words
    """Path of the parameter of the derivatives, shape (parameter)."""
    impacts: TimeHistoryImpacts
    """All impacts in order, one column each."""
    contacts: TimeHistoryContacts
    """Times at which coordinates rest at rigid walls, or stops push: one column each."""
    count: TimeHistoryCount
    """Numbers of events."""
    error: TimeHistoryError
    """Errors of the motion."""
    derivative: TimeHistoryDerivative
    """Derivatives of the outputs by the parameters, per unit of the parameter."""


class Ensemble(Result):
    """The motions from many initial states; outputs that were not requested are absent.

    The tables of all members follow one another in their order: member i has the rows
    ``offset[i]`` to ``offset[i] + count[i]`` of ``<table>_offset`` and ``<table>_count``. A
    member without a motion has no rows, and null (nan in files) in the arrays.
    """

    PARTS: ClassVar[dict[str, type[Table]]] = {
        "impacts": TimeHistoryImpacts,
        "contacts": TimeHistoryContacts,
        "count": EnsembleCount,
        "error": EnsembleError,
    }
    request: documents.EnsembleRequest
    member: Integers
    """Index of the initial state, shape (member)."""
    status: Words
    """Whether there is a motion, and if not why, shape (member)."""
    t: Floats
    """Time, shape (t), time."""
    dof: Integers
    """Index of the degree of freedom, shape (dof)."""
    x: Floats
    """Displacement, shape (member, t, dof), length; nan: the member has no motion."""
    v: Floats
    """Velocity, shape (member, t, dof), length / time; nan: the member has no motion."""
    a: Floats
    """Acceleration, shape (member, t, dof), length / time²; between impacts, without their
    impulses; nan: the member has no motion.
    """
    energy: Floats
    """Mechanical energy, that of the constant load and of compressed stops included, shape
    (member, t), mass length² / time²; nan: the member has no motion.
    """
    force: Floats
    """Force between a stop and the structure, shape (member, t, constraint), mass length /
    time²; of stops of finite stiffness; it only pushes; nan: the member has no motion.
    """
    impact_count: Integers
    """Rows of impacts of each member, shape (member)."""
    impact_offset: Integers
    """First row of impacts of each member, shape (member)."""
    contact_count: Integers
    """Rows of contacts of each member, shape (member)."""
    contact_offset: Integers
    """First row of contacts of each member, shape (member)."""
    impacts: TimeHistoryImpacts
    """All impacts in order, one column each."""
    contacts: TimeHistoryContacts
    """Times at which coordinates rest at rigid walls, or stops push: one column each."""
    count: EnsembleCount
    """Numbers of events of each member."""
    error: EnsembleError
    """Errors of each motion; null where a member has none."""


class SlowFlow(Result):
    """A motion by one of its descriptions; outputs that were not requested are absent."""

    PARTS: ClassVar[dict[str, type[Table]]] = {"impacts": SlowFlowImpacts, "error": SlowFlowError}
    request: documents.SlowFlowRequest
    t: Floats
    """Time, shape (t), time."""
    dof: Integers
    """Index of the degree of freedom, shape (dof)."""
    impact: Integers
    """Number of the impact of the exact motion, from 1, shape (impact)."""
    stage: Words
    """Stage of the motion, shape (t)."""
    gamma: Floats
    """Frequency ratio Omega0/omega (lambda of eq. 10.110), shape (t); nan: after the last
    impact, or unknown.
    """
    omega: Floats
    """Triangle-wave frequency, shape (t), 1/time; nan: after the last impact, or unknown."""
    phi: Floats
    """Phase of the triangle wave, shape (t); nan: after the last impact, or unknown."""
    A: Floats
    """Sine amplitude of the second mass, shape (t), length; nan: after the last impact, or
    unknown.
    """
    B: Floats
    """Cosine amplitude of the second mass, shape (t), length; nan: after the last impact, or
    unknown.
    """
    x: Floats
    """Displacement, shape (t, dof), length."""
    v: Floats
    """Velocity, shape (t, dof), length / time."""
    impulse: Floats
    """Impulse parameter p, shape (t), mass length / time²; nan: after the last impact, or
    unknown.
    """
    momentum: Floats
    """Momentum exchanged at an impact, shape (t), mass length / time; 2 p/omega; nan: after
    the last impact, or unknown.
    """
    t_max: Floats
    """End of the impacts by this variant, time; nan: they never end."""
    t_max_exact: Floats
    """End of the impacts of the exact motion, time; nan: they never end."""
    exists: Booleans
    """Whether the solution of a family is admissible."""
    impacts: SlowFlowImpacts
    """The impacts of the exact motion."""
    error: SlowFlowError
    """Absolute errors of the outputs of this variant, and times taken."""


class Calibration(Result):
    """The values that fit best, and what the measurements tell of them.

    Measurements are those that are not null, in the order of the data.
    """

    PARTS: ClassVar[dict[str, type[Table]]] = {
        "measurements": CalibrationMeasurements,
        "directions": CalibrationDirections,
        "starts": CalibrationStarts,
        "count": CalibrationCount,
        "error": CalibrationError,
    }
    NUMBERS: ClassVar[tuple[str, ...]] = (
        "chi2",
        "degrees_of_freedom",
        "p",
        "model_fits",
        "best",
        "converged",
    )
    request: documents.CalibrationRequest
    unknown: Words
    """Path of the unknown in the base, shape (unknown)."""
    unknown_unit: Words
    """Unit of the unknown, shape (unknown)."""
    value: Floats
    """Value that fits best, shape (unknown); in the units of the unknowns."""
    covariance: Floats
    """Covariance of the values, shape (unknown, other); in the units of the unknowns; of the
    equations made linear, for unknowns that are not at a bound; nan: the data does not tell it,
    or it is at a bound.
    """
    interval: Floats
    """95 % interval of each unknown, lower and upper end, shape (unknown, end); in the units
    of the unknowns; by profile of the likelihood, cut at the bounds; nan: no end: the data does
    not bound it.
    """
    undetermined: Words
    """Combination of unknowns, relative changes by the sizes of their values, that the data
    does not tell, shape (undetermined).
    """
    residual: Floats
    """Measured less computed value, by its standard deviation, shape (measurement)."""
    chi2: float
    """Sum of the squared residuals; with a term for each prior, and for impacts that the model
    has beyond those measured.
    """
    degrees_of_freedom: int
    """Measurements and priors less the combinations that they determine."""
    p: float
    """Probability of a larger chi2 if model and noise are right; absent without degrees of
    freedom.
    """
    model_fits: bool
    """Whether p is at least 0.05: the data does not reject the model; absent without degrees
    of freedom.
    """
    best: int
    """Index of the start that led to the best fit."""
    converged: bool
    """Whether the search from that start converged."""
    measurements: CalibrationMeasurements
    """All measured numbers, one column each."""
    directions: CalibrationDirections
    """Principal axes of the covariance, the least known first, in parts of the values."""
    starts: CalibrationStarts
    """Searches from each start, one column each."""
    count: CalibrationCount
    """Numbers of computations."""
    error: CalibrationError
    """Numerical errors of the outputs."""


class Sweep(Result):
    """Outputs of the base over a parameter grid."""

    request: documents.SweepRequest
    status: Words
    """Whether there is a result."""


KINDS: Final[dict[str, type[Result]]] = {
    "natural-frequencies": NaturalFrequencies,
    "impact-modes": ImpactModes,
    "existence-bands": ExistenceBands,
    "resonances": Resonances,
    "periodic-motions": PeriodicMotions,
    "branches": Branches,
    "attractors": Attractors,
    "time-history": TimeHistory,
    "ensemble": Ensemble,
    "slow-flow": SlowFlow,
    "calibration": Calibration,
    "sweep": Sweep,
}
"""Name of a kind -> class of its results."""


def read(content: bytes | Path | Parts) -> Result:
    """Return a result as what it is: the file of it, where that lies, or what it would have.

    Warns of what of the structure has no effect on it (`NeglectedWarning`), and of what is
    seldom meant in it (`StructureWarning`).
    """
    with reading(content) as file:
        kind = str(file.attrs["kind"])
    result = KINDS.get(kind, Result)(content)
    warn_of_structure(result.kind, result.neglected, result.cautions)
    return result
