"""The documents of the HTTP interface as types: ``structure: Chain = {"preset": "chain", …}``.

Written by ``client/write_types.py`` from ``openapi.json``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, NotRequired, TypedDict

Kind = Literal[
    "natural-frequencies",
    "impact-modes",
    "existence-bands",
    "resonances",
    "periodic-motions",
    "branches",
    "attractors",
    "time-history",
    "ensemble",
    "slow-flow",
    "calibration",
    "sweep",
]
"""Kinds of computation."""


_Continue = TypedDict("_Continue", {"continue": NotRequired[bool | None]})


class NaturalFrequenciesRequest(TypedDict):
    """Natural frequencies and mode shapes of the structure between its stops, without damping.

    The lowest ones, by their number or up to a frequency; that none is missing is proved.
    """

    system: System
    tolerance: NotRequired[float | None]
    """Relative error allowed; absent: what double precision gives. The error of the result
    says what keeps it.
    """
    count: NotRequired[int | None]
    """Number of modes, from the lowest; of a structure with fewer, all. Absent: 10, or all up
    to stop.
    """
    stop: NotRequired[float | None]
    """Instead of count: the frequency up to which all modes are returned."""
    unit: NotRequired[Literal["Omega", "omega", "Hz", "rpm"]]
    """Meaning of stop: Omega, a natural angular frequency; Hz and rpm, the same divided by 2
    pi, as in grids of frequencies; omega, times 2/pi. Default: "Omega".
    """
    fixed: NotRequired[Sequence[int]]
    """Indices of the constraints whose coordinates are held at zero."""
    directions: NotRequired[Sequence[Sequence[float]] | None]
    """Displacements of all degrees of freedom by unit motions of the base, a list for each
    direction [direction, dof], for effective_mass; absent: the influence of the system.
    """
    outputs: NotRequired[
        Sequence[
            Literal["Omega", "shape", "participation", "effective_mass", "residual_flexibility"]
        ]
    ]
    """Outputs; only these are computed, Omega always. Omega: natural angular frequencies
    [mode] (1/time); shape: mode shapes of unit modal mass [mode, dof] (1/√mass); participation:
    the constrained coordinates of the shapes [mode, constraint] (1/√mass); effective_mass:
    effective modal masses of motions of the base [mode, direction] (mass);
    residual_flexibility: static flexibility of all modes that are left out, of a free structure
    that of its elastic modes [constraint, constraint] (time² / mass). Default: ["Omega",
    "shape", "participation"].
    """
    derivatives: NotRequired[Sequence[str] | None]
    """Paths of numbers of the request by which all outputs are differentiated, as sweeps name
    them: names of fields, keys and indices from 0, separated by dots, such as
    system.constraints.0.gap or system.K.0.1, with which the symmetric entry changes too; or
    system.M.scale, system.K.scale and system.C.scale, a factor of the whole matrix; absent:
    none.
    """


class ImpactModesRequest(TypedDict):
    """Impact modes: periodic motions with one impact per half period at every active limiter.

    At each frequency there is one solution of the family, admissible or phantom.
    """

    system: System
    tolerance: NotRequired[float | None]
    """Relative error allowed; absent: what double precision gives. The error of the result
    says what keeps it.
    """
    frequency: Sequence[float] | FrequencyValues | FrequencyPoints | FrequencySteps
    active: NotRequired[Sequence[int] | None]
    """Indices of the constraints with impacts; absent: all."""
    dofs: NotRequired[Sequence[int] | None]
    """Degrees of freedom of shape and waveform; absent: all."""
    tau: NotRequired[Sequence[float] | None]
    """Triangle-wave times of the waveform, -1 to 1; required for waveform."""
    outputs: NotRequired[
        Sequence[
            Literal[
                "impulse",
                "exists",
                "reason",
                "shape",
                "waveform",
                "energy",
                "stability",
                "harmonics",
            ]
        ]
    ]
    """Outputs; only these are computed. impulse: the impulse parameter p [frequency,
    constraint] (mass length / time²) and the momentum exchanged at each impact, 2 p/omega (mass
    length / time); exists, reason: whether the solution is admissible, and if not, why
    [frequency]; shape: x at tau = 1 [frequency, dof] (length); waveform: x at tau [frequency,
    tau, dof] (length); energy [frequency] (mass length² / time²); stability: spectral radius of
    the half-period map, the growth of the fastest deviation per half period, and whether it is
    1 within its error, so that none is known to grow [frequency]; harmonics: Fourier amplitudes
    [frequency, harmonic, dof] (length). Default: ["impulse", "exists", "reason"].
    """
    derivatives: NotRequired[Sequence[str] | None]
    """Paths of numbers of the request by which all outputs are differentiated, as sweeps name
    them: names of fields, keys and indices from 0, separated by dots, such as
    system.constraints.0.gap or system.K.0.1, with which the symmetric entry changes too; or
    system.M.scale, system.K.scale and system.C.scale, a factor of the whole matrix; or
    frequency, the fundamental frequency Omega of each solution; absent: none.
    """


class ExistenceBandsRequest(TypedDict):
    """Ranges of frequency in which impact modes are admissible motions of the structure.

    With impacts at one limiter, equal gaps and no load they are proved to be all. Otherwise
    solutions between all poles are examined, and the result states which width could be missed.
    """

    system: System
    tolerance: NotRequired[float | None]
    """Relative accuracy of the edges; absent: 1e-12."""
    frequency: Sequence[float] | FrequencyInterval
    active: NotRequired[Sequence[int] | None]
    """Indices of the constraints with impacts; absent: all."""
    resolution: NotRequired[float | None]
    """Width, relative to that of the range, from which on all bands and gaps are found;
    narrower ones only by chance, and `error.complete` is false. Absent: all of them, which
    takes as long as there are poles.
    """
    outputs: NotRequired[Sequence[Literal["bands", "rejected", "stability"]]]
    """Outputs; only these are computed. bands: where solutions are admissible; rejected: where
    all impulses are positive but the solutions are phantoms; stability: where in the bands
    deviations from solutions grow. Default: ["bands", "rejected"].
    """


class ResonancesRequest(TypedDict):
    """Internal resonances: odd harmonics of impact modes at natural frequencies.

    These are the frequencies of the structure with the constrained coordinate held fixed.
    """

    system: System
    tolerance: NotRequired[float | None]
    """Relative error allowed; absent: what double precision gives. The error of the result
    says what keeps it.
    """
    constraint: NotRequired[int]
    """Index of the constraint with impacts. Default: 0."""
    odd_max: NotRequired[int]
    """Highest odd harmonic. Default: 9."""
    outputs: NotRequired[Sequence[Literal["Omega", "harmonic", "part"]]]
    """Outputs, each [resonance]. Default: ["Omega", "harmonic", "part"]."""


class PeriodicMotionsRequest(TypedDict):
    """Periodic motions of a driven, damped structure with a given sequence of impacts.

    At each frequency of the drive: the motion without impacts, and all motions with one impact
    per period, or with one at each wall half a period apart; longer sequences as far as a
    search finds them. With stops of finite stiffness contacts stand for impacts. Motions that
    are not admissible are listed too, with the reason.
    """

    system: System
    tolerance: NotRequired[float | None]
    """Relative error allowed; absent: what double precision gives. The error of the result
    says what keeps it.
    """
    load: NotRequired[Sequence[DriveTerm]]
    """The drive, in addition to the constant load of the system; empty: free motions of a
    structure without losses.
    """
    frequency: Sequence[float] | FrequencyValues | FrequencyPoints | FrequencySteps
    """Frequencies of the drive."""
    periods: NotRequired[int]
    """Periods of the drive in one period of the motion. Default: 1."""
    sequence: NotRequired[Sequence[SequenceImpact] | Literal["symmetric"]]
    """Impacts of one period in their order; or symmetric: one at each wall of a constraint
    with equal gaps, the second half of the period mirroring the first. Of stops of finite
    stiffness the contacts, in the order in which they begin. Absent: one impact at the upper
    wall of constraint 0. Default: [{"constraint": 0, "side": "upper"}].
    """
    constraint: NotRequired[int]
    """Constraint struck by a symmetric motion. Default: 0."""
    start: NotRequired[SequenceStart | None]
    """Where the search for several impacts per period begins; absent: at phases drawn at
    random, the same for every request.
    """
    dofs: NotRequired[Sequence[int] | None]
    """Degrees of freedom of extremes and waveform; absent: all."""
    tau: NotRequired[Sequence[float] | None]
    """Times t/T of the waveform, 0 to 1, from the drive's phase 0; required for waveform."""
    outputs: NotRequired[
        Sequence[Literal["exists", "extremes", "energy", "stability", "multipliers", "waveform"]]
    ]
    """What is computed beside the solutions and their impacts; absent: all, waveform where tau
    is given. exists: whether solutions are admissible, and why not; extremes: largest, smallest
    and root-mean-square displacements [solution, dof]; energy: work of the load and energy lost
    per period; stability: the largest modulus of the Floquet multipliers, and whether it is 1
    within its error; multipliers: all of them too; waveform: x at tau [solution, tau, dof].
    """


class BranchesRequest(TypedDict):
    """Branches of periodic motions over a range of one number of their request.

    Begun at all solutions at both ends of the range and between them, and followed through
    folds by pseudo-arclength. Special points are located and listed.
    """

    base: PeriodicMotionsRequest
    """The request whose number varies; it has one frequency."""
    path: str
    """Path of that number: names of fields, keys and indices from 0, separated by dots."""
    start: float
    """One end of the range."""
    stop: float
    """The other end."""
    switch: NotRequired[int]
    """Branches to follow that begin at flips and losses of symmetry of admissible motions, in
    their order. Default: 0.
    """
    stop_at: NotRequired[Sequence[Literal["fold", "flip", "torus", "symmetry", "grazing", "end"]]]
    """Special points at which a branch ends; absent: none. Default: []."""
    points: NotRequired[int]
    """Most points of a branch. Default: 2000."""
    step: NotRequired[float]
    """Longest step: part of the range, change of a phase (rad) or of an impulse relative to
    the usual one of the range. Default: 0.02.
    """


class AttractorsRequest(TypedDict):
    """Attractors: what the motions of a driven structure with stops settle on.

    From each initial state the motion is computed for settle + observe periods of the drive.
    Those that settle on the same attractor are counted. Motions start at the drive's phase 0.
    """

    system: System
    tolerance: NotRequired[float | None]
    """Distance of equal states relative to the amplitude; absent: 1e-6."""
    load: Sequence[DriveTerm]
    """The drive, in addition to the constant load of the system."""
    frequency: Sequence[float] | FrequencyValues | FrequencyPoints | FrequencySteps
    """Frequency of the drive: one value."""
    initial: InitialStates | InitialState | InitialMode | Sequence[InitialState | InitialMode]
    settle: NotRequired[int]
    """Periods of the drive that are left out. Default: 200."""
    observe: NotRequired[int]
    """Periods of the drive that are looked at after them; at least twice longest. Default:
    400.
    """
    longest: NotRequired[int]
    """Largest period, in periods of the drive, that is recognised. Default: 16."""
    section: NotRequired[Literal["phase", "impacts"]]
    """Points of the section: states at the drive's phase 0, or impacts; with stops of finite
    stiffness, where contacts begin. Default: "phase".
    """
    points: NotRequired[int]
    """Most points of the section of each attractor. Default: 200."""
    dofs: NotRequired[Sequence[int] | None]
    """Degrees of freedom of states and sections; absent: all."""
    outputs: NotRequired[Sequence[Literal["section", "stability"]]]
    """What is computed beside the attractors, their impacts and what each motion settles on.
    section: points of a Poincaré section of each attractor; stability: periodic attractors
    confirmed by Newton's method, with their multipliers. Default: ["section", "stability"].
    """


class TimeHistoryRequest(TypedDict):
    """Time history: the motion from an initial state, with every impact.

    Between impacts the motion is exact; tolerance is relative to the size of the motion, and
    the result states until when it can hold.
    """

    system: System
    tolerance: NotRequired[float | None]
    """Relative error allowed; absent: what double precision gives. The error of the result
    says what keeps it.
    """
    t_end: float
    """Length of the motion."""
    t: NotRequired[Sequence[float] | EqualTimes | TimeValues | TimePoints | TimeSteps | None]
    """Output times, ascending; required for x, v, a and energy."""
    dofs: NotRequired[Sequence[int] | None]
    """Degrees of freedom of x, v and a; absent: all."""
    load: NotRequired[Sequence[HarmonicLoad | SampledLoad | BaseMotion | HarmonicBase] | None]
    """Loads in addition to the constant one of the system: harmonic, sampled, or by a moving
    base.
    """
    limiter: NotRequired[RigidLimiter | PowerLimiter | None]
    """Force law of the limiters; absent: rigid."""
    method: NotRequired[Literal["exact", "RK45", "RK23", "DOP853", "Radau", "BDF", "LSODA"]]
    """exact, or an integrator of scipy for comparison, which can miss impacts. Default:
    "exact".
    """
    outputs: NotRequired[Sequence[Literal["x", "v", "a", "impacts", "energy", "contacts", "force"]]]
    """Outputs; only these are computed. x, v, a: displacement, velocity and acceleration
    [time, dof], this between impacts, of rigid stops and linear ones in double precision;
    impacts: a table of all impacts; energy: kinetic and elastic energy and that of the constant
    load [time]; contacts: a table of the times at which coordinates rest at rigid walls, or at
    which stops of finite stiffness push, with impulse, largest force, indentation and loss;
    force: the forces of stops of finite stiffness [time, constraint]. Default: ["impacts"].
    """
    initial: NotRequired[InitialState | InitialMode | None]
    """The state at t = 0; absent: at rest, with all displacements zero."""
    digits: NotRequired[int | None]
    """Decimal digits of the arithmetic where double precision cannot hold the tolerance to the
    end; absent: the result states until when it can.
    """
    derivatives: NotRequired[Sequence[str] | None]
    """Paths of numbers of the request by which all outputs are differentiated, as sweeps name
    them: names of fields, keys and indices from 0, separated by dots, such as
    system.constraints.0.gap or system.K.0.1, with which the symmetric entry changes too; or
    system.M.scale, system.K.scale and system.C.scale, a factor of the whole matrix; or
    initial.x.0, load.0.amplitude and other numbers of the motion. Between rigid stops; absent:
    none.
    """


class EnsembleRequest(TypedDict):
    """Ensemble: the motions of one structure from many initial states.

    A member that starts outside of the limits has no motion, as its status says; the others are
    computed. To vary anything else, use a sweep.
    """

    system: System
    tolerance: NotRequired[float | None]
    """Relative error allowed; absent: what double precision gives. The error of the result
    says what keeps it.
    """
    t_end: float
    """Length of the motion."""
    t: NotRequired[Sequence[float] | EqualTimes | TimeValues | TimePoints | TimeSteps | None]
    """Output times, ascending; required for x, v, a and energy."""
    dofs: NotRequired[Sequence[int] | None]
    """Degrees of freedom of x, v and a; absent: all."""
    load: NotRequired[Sequence[HarmonicLoad | SampledLoad | BaseMotion | HarmonicBase] | None]
    """Loads in addition to the constant one of the system: harmonic, sampled, or by a moving
    base.
    """
    limiter: NotRequired[RigidLimiter | PowerLimiter | None]
    """Force law of the limiters; absent: rigid."""
    method: NotRequired[Literal["exact", "RK45", "RK23", "DOP853", "Radau", "BDF", "LSODA"]]
    """exact, or an integrator of scipy for comparison, which can miss impacts. Default:
    "exact".
    """
    outputs: NotRequired[Sequence[Literal["x", "v", "a", "impacts", "energy", "contacts", "force"]]]
    """Outputs; only these are computed. x, v, a: displacement, velocity and acceleration
    [member, time, dof]; impacts, contacts: tables of all members, concatenated; energy: kinetic
    and elastic energy and that of the constant load [member, time]. Default: ["impacts"].
    """
    initial: InitialStates | InitialState | InitialMode | Sequence[InitialState | InitialMode]


class SlowFlowRequest(TypedDict):
    """Slow flow: a motion with impacts whose amplitude or frequency changes slowly.

    Each model has its system: `damped`: an oscillator with viscous damping between elastic
    walls; `two_oscillator`: the same with a second mass coupled to it; `restitution`: an
    oscillator between lossy walls; `bouncing_ball`: a mass under a constant load over a lossy
    floor; `oscillator`: an undamped one between elastic walls, or below one.
    """

    system: System
    tolerance: NotRequired[float | None]
    """Relative error allowed; absent: what double precision gives. The error of the result
    says what keeps it.
    """
    model: Literal["damped", "two_oscillator", "restitution", "bouncing_ball", "oscillator"]
    variant: Literal[
        "exact",
        "transformed",
        "averaged",
        "truncated",
        "leading",
        "soft_wall",
        "corrected",
        "second_order",
        "printed",
        "high_energy",
        "high_energy_printed",
        "grazing",
        "grazing_printed",
        "nstt",
        "nsct",
        "family",
    ]
    """Description of the motion: exact, of every model; transformed, averaged, truncated,
    leading of damped; transformed, averaged, truncated, soft_wall of two_oscillator; corrected,
    second_order, printed, high_energy, grazing and the last two as printed, of restitution;
    nstt and nsct of bouncing_ball; family of oscillator.
    """
    initial: SlowFlowInitial
    t: Sequence[float] | TimeValues | TimePoints | TimeSteps
    outputs: NotRequired[Sequence[Literal["state", "x", "v", "impulse", "error"]]]
    """Outputs; only these are computed. state: gamma, omega, phi, A, B as far as the model has
    them [time]; x, v: displacement and velocity [time, dof] (length, length / time); impulse:
    the impulse parameter p (mass length / time²) and the momentum exchanged at an impact, 2
    p/omega (mass length / time) [time]; error: differences from the exact motion, and its
    impacts. Default: ["state", "x", "v", "error"].
    """


class NaturalFrequenciesCalibration(TypedDict):
    """Numbers of a structure from its natural frequencies and mode shapes."""

    kind: Literal["natural-frequencies"]
    base: NaturalFrequenciesRequest
    """The request whose numbers are unknown; its outputs are those that are measured."""
    unknowns: Sequence[Unknown]
    """The unknown numbers."""
    data: Sequence[MeasuredOutput]
    """The measurements."""
    starts: NotRequired[int]
    """Searches at most: the first from the starts of the unknowns, the others from points
    between the bounds, within two standard deviations of the prior or, where there is neither,
    within half the start. They end when two agree on a fit that the data permits. Default: 8.
    """
    evaluations: NotRequired[int]
    """Most evaluations of the model in one search. Default: 100."""
    seed: NotRequired[int | None]
    """Of the points from which searches start; absent: made of the data."""
    outputs: NotRequired[
        Sequence[
            Literal[
                "value", "covariance", "interval", "undetermined", "residual", "chi2", "model_fits"
            ]
        ]
    ]
    """Outputs; only these are computed, the values always. value: the unknowns that fit best
    [unknown]; covariance: of the values [unknown, unknown]; interval: 95 % interval of each by
    profile of the likelihood [unknown, 2]; undetermined: combinations of unknowns that the data
    does not tell, and all principal directions; residual: measured less computed values, by
    their standard deviations; chi2: the sum of their squares, its degrees of freedom, and the
    probability of a larger one; model_fits: whether that is at least 0.05. Default: ["value",
    "covariance", "interval", "undetermined", "residual", "chi2", "model_fits"].
    """


class ImpactModesCalibration(TypedDict):
    """Numbers of a structure from its impact modes."""

    kind: Literal["impact-modes"]
    base: ImpactModesRequest
    """The request whose numbers are unknown; its outputs are those that are measured."""
    unknowns: Sequence[Unknown]
    """The unknown numbers."""
    data: Sequence[MeasuredOutput]
    """The measurements."""
    starts: NotRequired[int]
    """Searches at most: the first from the starts of the unknowns, the others from points
    between the bounds, within two standard deviations of the prior or, where there is neither,
    within half the start. They end when two agree on a fit that the data permits. Default: 8.
    """
    evaluations: NotRequired[int]
    """Most evaluations of the model in one search. Default: 100."""
    seed: NotRequired[int | None]
    """Of the points from which searches start; absent: made of the data."""
    outputs: NotRequired[
        Sequence[
            Literal[
                "value", "covariance", "interval", "undetermined", "residual", "chi2", "model_fits"
            ]
        ]
    ]
    """Outputs; only these are computed, the values always. value: the unknowns that fit best
    [unknown]; covariance: of the values [unknown, unknown]; interval: 95 % interval of each by
    profile of the likelihood [unknown, 2]; undetermined: combinations of unknowns that the data
    does not tell, and all principal directions; residual: measured less computed values, by
    their standard deviations; chi2: the sum of their squares, its degrees of freedom, and the
    probability of a larger one; model_fits: whether that is at least 0.05. Default: ["value",
    "covariance", "interval", "undetermined", "residual", "chi2", "model_fits"].
    """


class TimeHistoryCalibration(TypedDict):
    """Numbers of a structure, its load and its start from a record of a motion."""

    kind: Literal["time-history"]
    base: TimeHistoryRequest
    """The request whose numbers are unknown; its outputs are those that are measured."""
    unknowns: Sequence[Unknown]
    """The unknown numbers."""
    data: Sequence[MeasuredOutput]
    """The measurements."""
    starts: NotRequired[int]
    """Searches at most: the first from the starts of the unknowns, the others from points
    between the bounds, within two standard deviations of the prior or, where there is neither,
    within half the start. They end when two agree on a fit that the data permits. Default: 8.
    """
    evaluations: NotRequired[int]
    """Most evaluations of the model in one search. Default: 100."""
    seed: NotRequired[int | None]
    """Of the points from which searches start; absent: made of the data."""
    outputs: NotRequired[
        Sequence[
            Literal[
                "value", "covariance", "interval", "undetermined", "residual", "chi2", "model_fits"
            ]
        ]
    ]
    """Outputs; only these are computed, the values always. value: the unknowns that fit best
    [unknown]; covariance: of the values [unknown, unknown]; interval: 95 % interval of each by
    profile of the likelihood [unknown, 2]; undetermined: combinations of unknowns that the data
    does not tell, and all principal directions; residual: measured less computed values, by
    their standard deviations; chi2: the sum of their squares, its degrees of freedom, and the
    probability of a larger one; model_fits: whether that is at least 0.05. Default: ["value",
    "covariance", "interval", "undetermined", "residual", "chi2", "model_fits"].
    """


class PeriodicMotionsCalibration(TypedDict):
    """Numbers of a driven structure from its amplitudes over the frequency of the drive.

    A measured amplitude is that of the stable, admissible motion that is nearest to it.
    """

    kind: Literal["periodic-motions"]
    base: PeriodicMotionsRequest
    """The request whose numbers are unknown; its outputs are those that are measured."""
    unknowns: Sequence[Unknown]
    """The unknown numbers."""
    data: Sequence[MeasuredOutput]
    """The measurements."""
    starts: NotRequired[int]
    """Searches at most: the first from the starts of the unknowns, the others from points
    between the bounds, within two standard deviations of the prior or, where there is neither,
    within half the start. They end when two agree on a fit that the data permits. Default: 8.
    """
    evaluations: NotRequired[int]
    """Most evaluations of the model in one search. Default: 100."""
    seed: NotRequired[int | None]
    """Of the points from which searches start; absent: made of the data."""
    outputs: NotRequired[
        Sequence[
            Literal[
                "value", "covariance", "interval", "undetermined", "residual", "chi2", "model_fits"
            ]
        ]
    ]
    """Outputs; only these are computed, the values always. value: the unknowns that fit best
    [unknown]; covariance: of the values [unknown, unknown]; interval: 95 % interval of each by
    profile of the likelihood [unknown, 2]; undetermined: combinations of unknowns that the data
    does not tell, and all principal directions; residual: measured less computed values, by
    their standard deviations; chi2: the sum of their squares, its degrees of freedom, and the
    probability of a larger one; model_fits: whether that is at least 0.05. Default: ["value",
    "covariance", "interval", "undetermined", "residual", "chi2", "model_fits"].
    """


class NaturalFrequenciesSweep(_Continue):
    """Natural frequencies over a parameter grid: the same number of modes at every point."""

    kind: Literal["natural-frequencies"]
    base: NaturalFrequenciesRequest
    """The request whose fields vary."""
    axes: Sequence[AxisValues | AxisPoints | AxisSteps]
    """Each is a dimension of the outputs; in this order, they come first."""
    outputs: NotRequired[
        Sequence[
            Literal["Omega", "shape", "participation", "effective_mass", "residual_flexibility"]
        ]
        | None
    ]
    """What to compute; absent: the outputs of the base."""


class ImpactModesSweep(_Continue):
    """Impact modes over a parameter grid."""

    kind: Literal["impact-modes"]
    base: ImpactModesRequest
    """The request whose fields vary."""
    axes: Sequence[AxisValues | AxisPoints | AxisSteps]
    """Each is a dimension of the outputs; in this order, they come first."""
    outputs: NotRequired[
        Sequence[
            Literal[
                "impulse",
                "exists",
                "reason",
                "shape",
                "waveform",
                "energy",
                "stability",
                "harmonics",
            ]
        ]
        | None
    ]
    """What to compute; absent: the outputs of the base."""


class ExistenceBandsSweep(_Continue):
    """Existence bands over a parameter grid."""

    kind: Literal["existence-bands"]
    base: ExistenceBandsRequest
    """The request whose fields vary."""
    axes: Sequence[AxisValues | AxisPoints | AxisSteps]
    """Each is a dimension of the outputs; in this order, they come first."""
    outputs: NotRequired[Sequence[Literal["bands", "rejected", "stability"]] | None]
    """What to compute; absent: the outputs of the base."""


class ResonancesSweep(_Continue):
    """Internal resonances over a parameter grid."""

    kind: Literal["resonances"]
    base: ResonancesRequest
    """The request whose fields vary."""
    axes: Sequence[AxisValues | AxisPoints | AxisSteps]
    """Each is a dimension of the outputs; in this order, they come first."""
    outputs: NotRequired[Sequence[Literal["Omega", "harmonic", "part"]] | None]
    """What to compute; absent: the outputs of the base."""


class PeriodicMotionsSweep(_Continue):
    """Periodic motions over a parameter grid; impacts refer to the solutions of their point."""

    kind: Literal["periodic-motions"]
    base: PeriodicMotionsRequest
    """The request whose fields vary."""
    axes: Sequence[AxisValues | AxisPoints | AxisSteps]
    """Each is a dimension of the outputs; in this order, they come first."""
    outputs: NotRequired[
        Sequence[Literal["exists", "extremes", "energy", "stability", "multipliers", "waveform"]]
        | None
    ]
    """What to compute; absent: the outputs of the base."""


class AttractorsSweep(_Continue):
    """Attractors over a parameter grid: over one axis, a bifurcation diagram."""

    kind: Literal["attractors"]
    base: AttractorsRequest
    """The request whose fields vary."""
    axes: Sequence[AxisValues | AxisPoints | AxisSteps]
    """Each is a dimension of the outputs; in this order, they come first."""
    outputs: NotRequired[Sequence[Literal["section", "stability"]] | None]
    """What to compute; absent: the outputs of the base."""


class TimeHistorySweep(_Continue):
    """Time histories over a parameter grid."""

    kind: Literal["time-history"]
    base: TimeHistoryRequest
    """The request whose fields vary."""
    axes: Sequence[AxisValues | AxisPoints | AxisSteps]
    """Each is a dimension of the outputs; in this order, they come first."""
    outputs: NotRequired[
        Sequence[Literal["x", "v", "a", "impacts", "energy", "contacts", "force"]] | None
    ]
    """What to compute; absent: the outputs of the base."""


class SlowFlowSweep(_Continue):
    """Slow flows over a parameter grid."""

    kind: Literal["slow-flow"]
    base: SlowFlowRequest
    """The request whose fields vary."""
    axes: Sequence[AxisValues | AxisPoints | AxisSteps]
    """Each is a dimension of the outputs; in this order, they come first."""
    outputs: NotRequired[Sequence[Literal["state", "x", "v", "impulse", "error"]] | None]
    """What to compute; absent: the outputs of the base."""


class Webhook(TypedDict):
    """A server to which a message is sent when a job ends, signed by Standard Webhooks."""

    url: str
    """Address; https, and not in a private network."""
    secret: str
    """Signs the message: whsec_ and 24 to 64 bytes in base64."""


class MatrixSystem(TypedDict):
    """M x″ + C x′ + K x = force, with constraints."""

    damping: NotRequired[RatioDamping | RayleighDamping | StructuralDamping | None]
    """Damping by ratios, Rayleigh's or structural; absent: none, or C."""
    dashpots: NotRequired[Sequence[Dashpot] | None]
    """Dampers besides, which add to C."""
    influence: NotRequired[Sequence[float] | None]
    """Displacements of the structure by a unit displacement of its base, such as 1 for those
    in its direction, shape [n]; for loads by the base and effective masses.
    """
    residual_flexibility: NotRequired[Sequence[Sequence[float]] | None]
    """Rows of the static flexibility between the constraints of what a model of few modes
    leaves out, symmetric and positive semidefinite, shape [constraint, constraint]. It is in
    series with linear stops without damping; absent: none.
    """
    M: Sequence[Sequence[float]] | DiagonalMatrix | BandedMatrix | CoordinateMatrix | ScalarMatrix
    """Mass matrix, symmetric, shape [n, n]. Positive definite, apart from rows and columns of
    zeros: such degrees of freedom have no mass and follow the others statically. They need
    positive definite stiffness, and take no constraint, load or damping.
    """
    K: Sequence[Sequence[float]] | DiagonalMatrix | BandedMatrix | CoordinateMatrix | ScalarMatrix
    """Stiffness matrix, symmetric, shape [n, n]."""
    C: NotRequired[
        Sequence[Sequence[float]]
        | DiagonalMatrix
        | BandedMatrix
        | CoordinateMatrix
        | ScalarMatrix
        | None
    ]
    """Damping matrix, symmetric, shape [n, n]."""
    force: NotRequired[Sequence[float] | None]
    """Constant load, shape [n]."""
    constraints: NotRequired[Sequence[Constraint]]
    """Limiters; results refer to them by position. Absent: none. Default: []."""
    units: NotRequired[Units | None]
    """Absent: dimensionless."""


class Chain(TypedDict):
    """Equal masses joined by equal springs between fixed ends (eq. 10.60)."""

    damping: NotRequired[RatioDamping | RayleighDamping | StructuralDamping | None]
    """Damping by ratios, Rayleigh's or structural; absent: none, or C."""
    dashpots: NotRequired[Sequence[Dashpot] | None]
    """Dampers besides, which add to C."""
    influence: NotRequired[Sequence[float] | None]
    """Displacements of the structure by a unit displacement of its base, such as 1 for those
    in its direction, shape [n]; for loads by the base and effective masses.
    """
    residual_flexibility: NotRequired[Sequence[Sequence[float]] | None]
    """Rows of the static flexibility between the constraints of what a model of few modes
    leaves out, symmetric and positive semidefinite, shape [constraint, constraint]. It is in
    series with linear stops without damping; absent: none.
    """
    constraints: NotRequired[Sequence[Constraint]]
    """Limiters; results refer to them by position. Absent: none. Default: []."""
    units: NotRequired[Units | None]
    """Absent: dimensionless."""
    preset: Literal["chain"]
    n: int
    """Number of masses."""
    mass: NotRequired[float]
    """Each mass. Default: 1.0."""
    stiffness: NotRequired[float]
    """Each spring. Default: 1.0."""


class Oscillator(TypedDict):
    """One mass on a spring: M = 1, K = Omega0², C = 2 zeta Omega0."""

    damping: NotRequired[RatioDamping | RayleighDamping | StructuralDamping | None]
    """Damping by ratios, Rayleigh's or structural; absent: none, or C."""
    dashpots: NotRequired[Sequence[Dashpot] | None]
    """Dampers besides, which add to C."""
    influence: NotRequired[Sequence[float] | None]
    """Displacements of the structure by a unit displacement of its base, such as 1 for those
    in its direction, shape [n]; for loads by the base and effective masses.
    """
    residual_flexibility: NotRequired[Sequence[Sequence[float]] | None]
    """Rows of the static flexibility between the constraints of what a model of few modes
    leaves out, symmetric and positive semidefinite, shape [constraint, constraint]. It is in
    series with linear stops without damping; absent: none.
    """
    constraints: NotRequired[Sequence[Constraint]]
    """Limiters; results refer to them by position. Absent: none. Default: []."""
    units: NotRequired[Units | None]
    """Absent: dimensionless."""
    preset: Literal["oscillator"]
    Omega0: float
    """Natural angular frequency."""
    zeta: NotRequired[float]
    """Damping ratio. Default: 0.0."""


class TwoMass(TypedDict):
    """Two coupled oscillators: K = Omega0² [[1 + c, -c], [-c, 1 + c]] (eq. 10.22, 10.42)."""

    damping: NotRequired[RatioDamping | RayleighDamping | StructuralDamping | None]
    """Damping by ratios, Rayleigh's or structural; absent: none, or C."""
    dashpots: NotRequired[Sequence[Dashpot] | None]
    """Dampers besides, which add to C."""
    influence: NotRequired[Sequence[float] | None]
    """Displacements of the structure by a unit displacement of its base, such as 1 for those
    in its direction, shape [n]; for loads by the base and effective masses.
    """
    residual_flexibility: NotRequired[Sequence[Sequence[float]] | None]
    """Rows of the static flexibility between the constraints of what a model of few modes
    leaves out, symmetric and positive semidefinite, shape [constraint, constraint]. It is in
    series with linear stops without damping; absent: none.
    """
    constraints: NotRequired[Sequence[Constraint]]
    """Limiters; results refer to them by position. Absent: none. Default: []."""
    units: NotRequired[Units | None]
    """Absent: dimensionless."""
    preset: Literal["two_mass"]
    Omega0: float
    """Natural angular frequency of each alone."""
    coupling: NotRequired[float]
    """c above. Default: 1.0."""
    zeta: NotRequired[float]
    """Damping ratio of the first mass. Default: 0.0."""


class DoublePendulum(TypedDict):
    """Linearised double pendulum: M = [[mu², 1], [1, 1]], K = diag(mu², 1) (eq. 10.30)."""

    damping: NotRequired[RatioDamping | RayleighDamping | StructuralDamping | None]
    """Damping by ratios, Rayleigh's or structural; absent: none, or C."""
    dashpots: NotRequired[Sequence[Dashpot] | None]
    """Dampers besides, which add to C."""
    influence: NotRequired[Sequence[float] | None]
    """Displacements of the structure by a unit displacement of its base, such as 1 for those
    in its direction, shape [n]; for loads by the base and effective masses.
    """
    residual_flexibility: NotRequired[Sequence[Sequence[float]] | None]
    """Rows of the static flexibility between the constraints of what a model of few modes
    leaves out, symmetric and positive semidefinite, shape [constraint, constraint]. It is in
    series with linear stops without damping; absent: none.
    """
    constraints: NotRequired[Sequence[Constraint]]
    """Limiters; results refer to them by position. Absent: none. Default: []."""
    units: NotRequired[Units | None]
    """Absent: dimensionless."""
    preset: Literal["double_pendulum"]
    mu: float
    """Square root of the total mass ratio."""


class BouncingBall(TypedDict):
    """A ball over a floor: M = 1, K = 0, force -g."""

    damping: NotRequired[RatioDamping | RayleighDamping | StructuralDamping | None]
    """Damping by ratios, Rayleigh's or structural; absent: none, or C."""
    dashpots: NotRequired[Sequence[Dashpot] | None]
    """Dampers besides, which add to C."""
    influence: NotRequired[Sequence[float] | None]
    """Displacements of the structure by a unit displacement of its base, such as 1 for those
    in its direction, shape [n]; for loads by the base and effective masses.
    """
    residual_flexibility: NotRequired[Sequence[Sequence[float]] | None]
    """Rows of the static flexibility between the constraints of what a model of few modes
    leaves out, symmetric and positive semidefinite, shape [constraint, constraint]. It is in
    series with linear stops without damping; absent: none.
    """
    constraints: NotRequired[Sequence[Constraint]]
    """Limiters; results refer to them by position. Absent: none. Default: []."""
    units: NotRequired[Units | None]
    """Absent: dimensionless."""
    preset: Literal["bouncing_ball"]
    g: NotRequired[float]
    """Acceleration of gravity. Default: 9.81."""


class Absorber(TypedDict):
    """A mass on a spring that carries a small one, coordinate 1.

    M = diag(1, r), K = Omega0² [[1 + r t², -r t²], [-r t², r t²]]. A stop between the two has a
    direction: dofs [1, 0], weights [1, -1].
    """

    damping: NotRequired[RatioDamping | RayleighDamping | StructuralDamping | None]
    """Damping by ratios, Rayleigh's or structural; absent: none, or C."""
    dashpots: NotRequired[Sequence[Dashpot] | None]
    """Dampers besides, which add to C."""
    influence: NotRequired[Sequence[float] | None]
    """Displacements of the structure by a unit displacement of its base, such as 1 for those
    in its direction, shape [n]; for loads by the base and effective masses.
    """
    residual_flexibility: NotRequired[Sequence[Sequence[float]] | None]
    """Rows of the static flexibility between the constraints of what a model of few modes
    leaves out, symmetric and positive semidefinite, shape [constraint, constraint]. It is in
    series with linear stops without damping; absent: none.
    """
    constraints: NotRequired[Sequence[Constraint]]
    """Limiters; results refer to them by position. Absent: none. Default: []."""
    units: NotRequired[Units | None]
    """Absent: dimensionless."""
    preset: Literal["absorber"]
    Omega0: float
    """Natural angular frequency of the large mass alone."""
    ratio: NotRequired[float]
    """Small mass over the large one, r. Default: 0.05."""
    tuning: NotRequired[float]
    """Frequency of the small mass alone over Omega0, t; 0: it has no spring, and only its
    stops hold it. Default: 1.0.
    """


class Beam(TypedDict):
    """A cantilever of equal Euler-Bernoulli elements.

    Degrees of freedom: deflection and rotation of each node in turn, from the clamp on.
    """

    damping: NotRequired[RatioDamping | RayleighDamping | StructuralDamping | None]
    """Damping by ratios, Rayleigh's or structural; absent: none, or C."""
    dashpots: NotRequired[Sequence[Dashpot] | None]
    """Dampers besides, which add to C."""
    influence: NotRequired[Sequence[float] | None]
    """Displacements of the structure by a unit displacement of its base, such as 1 for those
    in its direction, shape [n]; for loads by the base and effective masses.
    """
    residual_flexibility: NotRequired[Sequence[Sequence[float]] | None]
    """Rows of the static flexibility between the constraints of what a model of few modes
    leaves out, symmetric and positive semidefinite, shape [constraint, constraint]. It is in
    series with linear stops without damping; absent: none.
    """
    constraints: NotRequired[Sequence[Constraint]]
    """Limiters; results refer to them by position. Absent: none. Default: []."""
    units: NotRequired[Units | None]
    """Absent: dimensionless."""
    preset: Literal["beam"]
    elements: int
    """Number of elements; twice as many degrees of freedom."""
    length: NotRequired[float]
    """Of the whole beam. Default: 1.0."""
    EI: NotRequired[float]
    """Bending stiffness. Default: 1.0."""
    rhoA: NotRequired[float]
    """Mass per length. Default: 1.0."""


class SystemReference(TypedDict):
    """A system stored by POST /v1/systems."""

    id: str
    """Its name, as POST /v1/systems returned it."""
    constraints: NotRequired[Sequence[Constraint] | None]
    """Replace the stored constraints; absent: keep them."""
    damping: NotRequired[RatioDamping | RayleighDamping | StructuralDamping | None]
    """Replaces the stored damping, of a system without C; absent: keep it."""
    residual_flexibility: NotRequired[Sequence[Sequence[float]] | None]
    """Replaces the stored one, as constraints do where it is absent, which have none then;
    absent without constraints: keep it.
    """


class FrequencyValues(TypedDict):
    """A list of frequencies, in any order."""

    unit: NotRequired[Literal["Omega", "omega", "Hz", "rpm"]]
    """Meaning of the numbers: Omega, the fundamental angular frequency of the motion, or omega
    = (2/pi) Omega, that of the triangle wave; rad per unit of time. Hz and rpm: Omega / (2 pi)
    per second and per minute, of a system whose unit of time is ns, us, ms, s, min or h, or
    none, which stands for s. Default: "Omega".
    """
    values: Sequence[float]
    """The frequencies."""


class FrequencyPoints(TypedDict):
    """A number of equally spaced frequencies, both ends included."""

    unit: NotRequired[Literal["Omega", "omega", "Hz", "rpm"]]
    """Meaning of the numbers: Omega, the fundamental angular frequency of the motion, or omega
    = (2/pi) Omega, that of the triangle wave; rad per unit of time. Hz and rpm: Omega / (2 pi)
    per second and per minute, of a system whose unit of time is ns, us, ms, s, min or h, or
    none, which stands for s. Default: "Omega".
    """
    start: float
    """First frequency."""
    stop: float
    """Last frequency; not below start."""
    num: int
    """Number of points."""


class FrequencySteps(TypedDict):
    """Frequencies start, start + step, … up to stop, which is included if a step reaches it."""

    unit: NotRequired[Literal["Omega", "omega", "Hz", "rpm"]]
    """Meaning of the numbers: Omega, the fundamental angular frequency of the motion, or omega
    = (2/pi) Omega, that of the triangle wave; rad per unit of time. Hz and rpm: Omega / (2 pi)
    per second and per minute, of a system whose unit of time is ns, us, ms, s, min or h, or
    none, which stands for s. Default: "Omega".
    """
    start: float
    """First frequency."""
    stop: float
    """Last frequency; not below start."""
    step: float
    """Distance between neighbours."""


class FrequencyInterval(TypedDict):
    """All frequencies between two."""

    unit: NotRequired[Literal["Omega", "omega", "Hz", "rpm"]]
    """Meaning of the numbers: Omega, the fundamental angular frequency of the motion, or omega
    = (2/pi) Omega, that of the triangle wave; rad per unit of time. Hz and rpm: Omega / (2 pi)
    per second and per minute, of a system whose unit of time is ns, us, ms, s, min or h, or
    none, which stands for s. Default: "Omega".
    """
    start: float
    """First frequency."""
    stop: float
    """Last frequency; not below start."""


class DriveTerm(TypedDict):
    """A load ``amplitude cos(harmonic Omega t + phase)``, Omega being the drive's frequency.

    Or a base that moves so, to which all else is then relative.
    """

    dof: NotRequired[int | None]
    """Degree of freedom on which it acts."""
    direction: NotRequired[Direction | None]
    """In place of dof: it acts on several of them, by these weights."""
    base: NotRequired[Literal["acceleration", "velocity", "displacement"] | None]
    """In place of dof: the base moves, by the influence of the system, and amplitude is that
    of its acceleration, velocity or displacement.
    """
    amplitude: float
    """Its amplitude, mass length / time²; of a base, length / time² or so."""
    scale: NotRequired[Literal["Omega2"] | None]
    """Omega2: the amplitude is multiplied by the square of the drive's frequency, as that of
    an unbalance, whose amplitude is then mass times eccentricity.
    """
    harmonic: NotRequired[int]
    """Multiple of the drive's frequency. Default: 1."""
    phase: NotRequired[float]
    """Its phase at t = 0. Default: 0.0."""


class SequenceImpact(TypedDict):
    """One impact of a sequence."""

    constraint: int
    """Index of the constraint."""
    side: NotRequired[Literal["upper", "lower"]]
    """The wall that is struck. Default: "upper"."""


class SequenceStart(TypedDict):
    """Where the search for a sequence of several impacts begins."""

    phases: Sequence[Sequence[float]]
    """Phases Omega t of the impacts in their order [guess, impact], rad."""


class InitialStates(TypedDict):
    """Initial states of many motions, at t = 0."""

    x: Sequence[Sequence[float]]
    """Displacements [motion, dof]."""
    v: Sequence[Sequence[float]]
    """Velocities [motion, dof]."""


class InitialState(TypedDict):
    """Displacements and velocities at t = 0."""

    x: Sequence[float]
    """Displacements [dof], within all limits."""
    v: Sequence[float]
    """Velocities [dof]."""


class InitialMode(TypedDict):
    """An impact mode at tau = 0, half-way between its impacts."""

    impact_mode: Member


class EqualTimes(TypedDict):
    """A number of equally spaced times from 0 to t_end, both included."""

    num: int
    """Number of times."""


class TimeValues(TypedDict):
    """A list of times, in any order."""

    values: Sequence[float]
    """The times, not negative."""


class TimePoints(TypedDict):
    """A number of equally spaced times, both ends included."""

    start: NotRequired[float]
    """First time. Default: 0.0."""
    stop: float
    """Last time; after start."""
    num: int
    """Number of points."""


class TimeSteps(TypedDict):
    """Times start, start + step, … up to stop, which is included if a step reaches it."""

    start: NotRequired[float]
    """First time. Default: 0.0."""
    stop: float
    """Last time; after start."""
    step: float
    """Distance between neighbours."""


class HarmonicLoad(TypedDict):
    """A load ``amplitude cos(frequency t + phase)`` on one degree of freedom."""

    dof: int
    """Degree of freedom on which it acts."""
    amplitude: float
    """Its amplitude, mass length / time²."""
    frequency: float
    """Its angular frequency."""
    phase: NotRequired[float]
    """Its phase at t = 0. Default: 0.0."""


class SampledLoad(TypedDict):
    """A load given by samples, measured say, a straight line from each to the next."""

    t: NotRequired[Sequence[float] | None]
    """Ascending times of the samples, from 0 or before to t_end or after."""
    interval: NotRequired[float | None]
    """In place of t: time between two samples, the first one at t = 0."""
    dof: NotRequired[int | None]
    """Degree of freedom on which it acts."""
    direction: NotRequired[Direction | None]
    """In place of dof: it acts on several of them, by these weights."""
    force: Sequence[float]
    """Its values, mass length / time² [sample]."""


class BaseMotion(TypedDict):
    """A base that moves; displacements and velocities are relative to it."""

    t: NotRequired[Sequence[float] | None]
    """Ascending times of the samples, from 0 or before to t_end or after."""
    interval: NotRequired[float | None]
    """In place of t: time between two samples, the first one at t = 0."""
    base: Sequence[float] | Literal["acceleration"]
    """Displacements of the structure that a unit displacement of the base gives [dof]: 1 for
    those in its direction; or acceleration: those are the influence of the system.
    """
    acceleration: Sequence[float]
    """Acceleration of the base, a straight line from each sample to the next [sample]."""


class HarmonicBase(TypedDict):
    """A base that moves by ``amplitude cos(frequency t + phase)``; all else is relative to it.

    The system has its influence.
    """

    base: Literal["acceleration", "velocity", "displacement"]
    """What of the base the amplitude is."""
    amplitude: float
    """Its amplitude: length, with velocity / time, …."""
    frequency: float
    """Its angular frequency."""
    phase: NotRequired[float]
    """Its phase at t = 0. Default: 0.0."""


class RigidLimiter(TypedDict):
    """Rigid limiters: impacts with the coefficients of restitution of the constraints."""

    law: Literal["rigid"]


class PowerLimiter(TypedDict):
    """Soft limiters: the force -stiffness (y / (scale gap))^exponent on each coordinate.

    It acts from y = 0 on; the law of a constraint acts from its gap on.
    """

    law: Literal["power"]
    exponent: NotRequired[float]
    """At least 1. Default: 17.0."""
    stiffness: NotRequired[float]
    """Force at scale times the gap. Default: 1.0."""
    scale: NotRequired[float]
    """Factor of the gaps. Default: 1.0."""


class SlowFlowInitial(TypedDict):
    """Initial state of a slow flow, at t = 0; each model uses some of the fields."""

    gamma: NotRequired[float | None]
    """Frequency ratio Omega0/omega (lambda of eq. 10.110); damped, two_oscillator,
    restitution, oscillator.
    """
    phi: NotRequired[float | None]
    """Phase of the triangle wave, absent: 0; damped, two_oscillator, oscillator."""
    A: NotRequired[float | None]
    """Sine amplitude of the second mass, absent: 0; two_oscillator."""
    B: NotRequired[float | None]
    """Cosine amplitude of the second mass, absent: 0; two_oscillator."""
    omega: NotRequired[float | None]
    """Triangle-wave frequency in place of gamma; restitution."""
    energy: NotRequired[float | None]
    """Total energy in place of gamma (eq. 10.10); oscillator."""
    root: NotRequired[int | None]
    """Index of gamma among those of that energy, ascending, absent: 0; oscillator."""
    x: NotRequired[float | None]
    """Displacement, with v in place of omega: restitution; height of release: bouncing_ball."""
    v: NotRequired[float | None]
    """Velocity; restitution."""


class Unknown(TypedDict):
    """An unknown number of the base."""

    path: str
    """Its path in the base, as sweeps name it; or system.M.scale, system.K.scale,
    system.C.scale: a factor of the whole matrix, 1 in the base.
    """
    start: float
    """Where the first search begins, in place of the base's."""
    lower: NotRequired[float | None]
    """Smallest value; absent: none."""
    upper: NotRequired[float | None]
    """Largest value; absent: none."""
    prior: NotRequired[Prior | None]
    """Absent: nothing is known beforehand."""


class MeasuredOutput(TypedDict):
    """Measurements of one output of the base, with normal noise that is not correlated."""

    output: str
    """Its path in results, with dots: a numeric output that has derivatives, or an amplitude
    of periodic motions, solution.x_max, solution.x_min or solution.rms.
    """
    values: (
        Sequence[float | None]
        | Sequence[Sequence[float | None]]
        | Sequence[Sequence[Sequence[float | None]]]
    )
    """Measured values in the shape of the output, null where nothing was measured. Of modes
    the lowest ones; of impacts all from 0 to t_end, in their order; of periodic motions a row
    for each frequency.
    """
    sigma: float | Sequence[float] | Sequence[Sequence[float]]
    """Standard deviation of the noise: one number, or one for each value, in the same shape."""
    t: NotRequired[Sequence[float] | None]
    """Times of the rows of a history, ascending, in place of the base's t; absent: these."""


class AxisValues(TypedDict):
    """A list of values, in any order."""

    path: str
    """Path of the number of the base request that varies: names of fields, keys and indices
    from 0, separated by dots. With an entry of a matrix the symmetric entry varies too.
    """
    name: NotRequired[str | None]
    """Name of the dimension; absent: the shortest end of the path that distinguishes the axis
    from the others.
    """
    values: Sequence[float]


class AxisPoints(TypedDict):
    """A number of equally spaced values, both ends included."""

    path: str
    """Path of the number of the base request that varies: names of fields, keys and indices
    from 0, separated by dots. With an entry of a matrix the symmetric entry varies too.
    """
    name: NotRequired[str | None]
    """Name of the dimension; absent: the shortest end of the path that distinguishes the axis
    from the others.
    """
    start: float
    """First value."""
    stop: float
    """Last value; below start, the values descend."""
    num: int
    """Number of values."""


class AxisSteps(TypedDict):
    """Values start, start + step, … to stop, which is included if a step reaches it.

    They are computed in decimal arithmetic and rounded once, so that a longer or a shifted axis
    with the same step has the same numbers, whose results are reused.
    """

    path: str
    """Path of the number of the base request that varies: names of fields, keys and indices
    from 0, separated by dots. With an entry of a matrix the symmetric entry varies too.
    """
    name: NotRequired[str | None]
    """Name of the dimension; absent: the shortest end of the path that distinguishes the axis
    from the others.
    """
    start: float
    """First value."""
    stop: float
    """Last value; below start, the values descend."""
    step: float
    """Difference of neighbours, not 0; negative where stop lies below start."""


class RatioDamping(TypedDict):
    """Damping by parts of the critical damping of the natural modes."""

    ratio: float | Sequence[float]
    """Damping ratio zeta of all modes, or a list of one for each, from the lowest; of at most
    512 degrees of freedom with mass: C is full. Rigid-body modes have none.
    """


class RayleighDamping(TypedDict):
    """Damping proportional to the masses and to the springs."""

    rayleigh: Sequence[float] | RayleighRatios
    """Its two coefficients, or the ratios that they make."""


class StructuralDamping(TypedDict):
    """Viscous damping that is equivalent to a loss factor at one frequency: C = (eta/Omega) K."""

    structural: float
    """Loss factor eta."""
    at: float
    """The frequency at which they lose the same."""
    unit: NotRequired[Literal["Omega", "omega", "Hz", "rpm"]]
    """Meaning of the frequency, as in grids of them. Default: "Omega"."""


class Dashpot(TypedDict):
    """A viscous damper of the coordinate Σ weight · x[dof]."""

    dofs: Sequence[int]
    """Degrees of freedom, each once."""
    weights: Sequence[float]
    """Weight of each of them."""
    c: float
    """Force by unit velocity (mass / time)."""


class DiagonalMatrix(TypedDict):
    """A diagonal matrix."""

    diagonal: Sequence[float]
    """The n diagonal entries."""


class BandedMatrix(TypedDict):
    """A symmetric banded matrix by its diagonals."""

    bands: Mapping[str, Any]
    """Offset from the main diagonal -> that diagonal, of n - offset entries; each stands for
    the lower one too. Absent offsets are zero.
    """


class CoordinateMatrix(TypedDict):
    """A sparse matrix by the coordinates of its entries; symmetric entries are both given."""

    shape: Sequence[int]
    """[n, n]."""
    row: Sequence[int]
    """Row of each entry, from 0."""
    col: Sequence[int]
    """Column of each entry, from 0."""
    data: Sequence[float]
    """Value of each entry."""


class ScalarMatrix(TypedDict):
    """A number times the identity."""

    scalar: float
    """The number."""
    n: int
    """Size of the identity."""


class Constraint(TypedDict):
    """A stop: a coordinate, its gap, and what happens beyond it."""

    dof: NotRequired[int | None]
    """The constrained degree of freedom, from 0."""
    direction: NotRequired[Direction | None]
    """Instead of dof: a combination, such as a relative displacement."""
    gap: float | Limits
    """Distance to the walls from the coordinate's zero (length)."""
    restitution: NotRequired[float]
    """Newton's coefficient of restitution of a rigid stop; 1 is elastic. Default: 1.0."""
    law: NotRequired[RigidLaw | LinearLaw | HertzLaw | PowerLaw | None]
    """What the stop does beyond its wall; absent: it is rigid. A stop with a law has no
    restitution beside it.
    """
    wall: NotRequired[Sequence[WallSwing] | WallSamples | None]
    """How both walls move, which is added to their places: harmonic terms, or samples. Of
    linear stops in time histories and, harmonics of the drive, in periodic motions; absent:
    they are at rest.
    """


class Units(TypedDict):
    """The consistent set of units of the numbers."""

    length: str
    mass: str
    """Also composed ones, such as "lbf s2/in"."""
    time: str


class Direction(TypedDict):
    """A direction in configuration space: the constrained coordinate is Σ weight · x[dof]."""

    dofs: Sequence[int]
    """Degrees of freedom, each once."""
    weights: Sequence[float]
    """Weight of each of them."""


class Member(TypedDict):
    """One impact mode of a family."""

    Omega: float
    """Its fundamental angular frequency."""
    active: NotRequired[Sequence[int] | None]
    """Indices of the constraints at which it has impacts; absent: all."""


class Prior(TypedDict):
    """What is known of an unknown beforehand: a normal distribution."""

    mean: float
    """Its mean."""
    sigma: float
    """Its standard deviation."""


class RayleighRatios(TypedDict):
    """Damping ratios at two frequencies."""

    ratios: Sequence[float]
    """Damping ratios zeta."""
    at: Sequence[float]
    """The frequencies, which differ."""
    unit: NotRequired[Literal["Omega", "omega", "Hz", "rpm"]]
    """Meaning of the frequencies, as in grids of them. Default: "Omega"."""


class Limits(TypedDict):
    """Two limits of one coordinate, -lower ≤ y ≤ upper; lower + upper > 0."""

    lower: NotRequired[float | None]
    """Distance to the lower wall; null: no wall."""
    upper: NotRequired[float | None]
    """Distance to the upper wall; null: no wall."""


class RigidLaw(TypedDict):
    """A rigid stop: Newton's impact law."""

    type: Literal["rigid"]
    restitution: NotRequired[float]
    """Newton's coefficient of restitution; 1 is elastic. Default: 1.0."""


class LinearLaw(TypedDict):
    """A spring and a dashpot that only push: the force is max(0, k d + c d′).

    d is the indentation. Give either the damping, or the restitution of a free mass that is as
    large as the effective mass of the coordinate.
    """

    type: Literal["linear"]
    stiffness: float
    """k, force by length."""
    damping: NotRequired[float | None]
    """c, force by velocity; absent: none."""
    restitution: NotRequired[float | None]
    """Ratio of the speeds after and before a contact, instead of the damping."""


class HertzLaw(TypedDict):
    """An elastic contact of curved surfaces: the force is k d^(3/2).

    d is the indentation.
    """

    type: Literal["hertz"]
    stiffness: float
    """k, force by length^(3/2)."""


class PowerLaw(TypedDict):
    """An elastic stop whose force grows with a power of the indentation d: it is k d^n."""

    type: Literal["power"]
    stiffness: float
    """k, force by length^n."""
    exponent: float
    """n; 1 is a spring, 1.5 the law of Hertz."""


class WallSwing(TypedDict):
    """A displacement ``amplitude cos(frequency t + phase)`` of both walls of a stop.

    In periodic motions it has a harmonic of the drive instead of a frequency.
    """

    amplitude: float
    """Its amplitude, length."""
    frequency: NotRequired[float | None]
    """Its angular frequency."""
    harmonic: NotRequired[int | None]
    """Instead of it: its frequency as a multiple of the drive's."""
    phase: NotRequired[float]
    """Its phase at t = 0. Default: 0.0."""


class WallSamples(TypedDict):
    """Displacements of both walls of a stop at times, with straight lines between."""

    t: Sequence[float]
    """Ascending times, from 0 or before to t_end or after."""
    y: Sequence[float]
    """Displacements at these times."""


class Job(TypedDict):
    """A queued computation."""

    id: str
    version: int
    """Number of the last change; also the id of its event."""
    kind: str
    name: NotRequired[str | None]
    """What it was called when it was queued."""
    state: Literal["queued", "running", "succeeded", "failed", "cancelled"]
    final: bool
    """Whether the state will not change any more."""
    phase: str
    """Activity within the state."""
    waiting_reason: str | None
    """Why it is not running yet."""
    queue_position: int | None
    """Number of jobs before it; null once it runs."""
    progress: Progress
    priority: int
    created: str
    started: str | None
    finished: str | None
    deadline: NotRequired[str | None]
    """Time at which it fails if it is not done."""
    attempts: int
    """Number of times it was started."""
    history: NotRequired[list[Attempt] | None]
    """The attempts at it, the earliest first; null in lists and events."""
    estimate: float | None
    """Planned seconds of computing."""
    reused: bool
    """Whether the result was known before."""
    digest: str
    """Name that the result has or will have."""
    result: str | None
    """Address of the result, once there is one."""
    error: Problem | None
    """Why it failed."""


class Plan(TypedDict):
    """The answer of POST /v1/plan/{kind}."""

    steps: list[PlanStep]
    skips: list[PlanSkip]
    flops: float
    """Estimated floating-point operations of all steps."""
    bytes: float
    """Estimated memory written by all steps."""
    bounded: NotRequired[bool]
    """Whether the price is an upper bound; false where it has none, as it goes with numbers,
    such as that of the impacts, which only the computation tells.
    """
    kind: str
    digest: str
    """Name that the result has or will have."""
    seconds: float
    """Estimated time on this machine."""
    cached: bool
    """Whether the result is known."""
    inline: bool
    """Whether POST /v1/compute would answer at once."""


class Version(TypedDict):
    """Version and capabilities of the service."""

    service: str
    solvers: str
    api: str
    kinds: list[str]
    representations: list[str]
    """Media types of results."""
    codings: list[str]
    """Content codings of answers."""
    system_types: list[str]
    """Media types in which systems are taken."""
    capabilities: list[str]
    """Further capabilities: keys, oidc, events, ranges, idempotency, …"""
    limits: ServiceLimits


class StoredSystem(TypedDict):
    """A stored system."""

    id: str
    n: int
    """Degrees of freedom."""
    constraints: int
    """Number of constraints."""
    unused: NotRequired[list[str]]
    """Names of what the files have and the system does not use, at most 100."""


class Progress(TypedDict):
    """Progress of a job; the unit depends on the kind."""

    done: int
    total: int
    kept: NotRequired[int]
    """How many of those done were known before."""


class Attempt(TypedDict):
    """An attempt at a job, or at a part of it."""

    worker: str
    """Process that ran the job, or worker process that was lost while it computed a part of
    it.
    """
    began: str
    ended: str | None
    """Null while it goes on."""
    why: str | None
    """Why it ended."""


class Problem(TypedDict):
    """Description of an error (RFC 9457)."""

    type: str
    """Address of the page about this type of problem."""
    title: str
    """The type in words."""
    status: int
    """The HTTP status."""
    detail: str
    """Description of this occurrence."""
    instance: str
    """Name of this occurrence."""
    request_id: str
    """As in the header X-Request-ID."""
    code: str
    """Stable short name of the type."""
    retryable: bool
    """Whether the same request can succeed later."""
    errors: list[Fault]
    """The faults, where they can be located."""


class PlanStep(TypedDict):
    """A step of a computation."""

    stage: str
    """Quantity that it computes."""
    method: str
    """The method chosen."""
    reason: str
    """Why this method."""
    flops: float
    """Estimated floating-point operations."""
    bytes: float
    """Estimated memory written."""
    count: NotRequired[int]
    """Number of times it is done in a sweep or an ensemble."""
    bounded: NotRequired[bool]
    """Whether flops and bytes are upper bounds."""


class PlanSkip(TypedDict):
    """Something that is not computed."""

    what: str
    why: str


class ServiceLimits(TypedDict):
    """What the service accepts."""

    body_bytes: int
    header_bytes: int
    """Address and header fields together."""
    points: int
    """Points of a grid."""
    job_seconds: float
    """Planned computing time of one request."""
    unfinished_jobs: int
    """Unfinished jobs of one owner."""
    requests_per_minute: int | None
    """Of a key that has no number of its own; null where no keys are needed."""
    seconds_per_hour: float | None
    """Planned computing time of such a key; null where no keys are needed."""
    dofs: int
    """Degrees of freedom of a system."""
    result_bytes: int
    """Largest result, by the numbers it would hold."""
    inline_seconds: float
    """Planned work above it becomes a job."""
    batch_requests: int
    """Most requests of one batch."""
    batch_seconds: float
    """Most planned work of one of them."""
    wait_seconds: float
    """Longest wait of Prefer: wait."""
    poll_seconds: float
    """Longest wait of GET /v1/jobs/{id}?wait=."""


class Fault(TypedDict):
    """One fault of a request."""

    pointer: str
    """JSON pointer (RFC 6901) of the faulty place in the request's body; empty for the whole
    body and for faults outside of it.
    """
    parameter: NotRequired[str | None]
    """Name of the faulty header or of the path or query parameter."""
    code: str
    """Stable short name."""
    message: str
    """What is wrong and what would be right."""


System = (
    MatrixSystem
    | Chain
    | Oscillator
    | TwoMass
    | DoublePendulum
    | BouncingBall
    | Absorber
    | Beam
    | SystemReference
)
"""A structure."""

CalibrationRequest = (
    NaturalFrequenciesCalibration
    | ImpactModesCalibration
    | TimeHistoryCalibration
    | PeriodicMotionsCalibration
)
"""Unknown numbers of a request, and measurements."""

SweepRequest = (
    NaturalFrequenciesSweep
    | ImpactModesSweep
    | ExistenceBandsSweep
    | ResonancesSweep
    | PeriodicMotionsSweep
    | AttractorsSweep
    | TimeHistorySweep
    | SlowFlowSweep
)
"""A computation over a parameter grid."""

Request = (
    NaturalFrequenciesRequest
    | ImpactModesRequest
    | ExistenceBandsRequest
    | ResonancesRequest
    | PeriodicMotionsRequest
    | BranchesRequest
    | AttractorsRequest
    | TimeHistoryRequest
    | EnsembleRequest
    | SlowFlowRequest
    | CalibrationRequest
    | SweepRequest
)
"""A request of any kind."""

BaseRequest = (
    NaturalFrequenciesRequest
    | ImpactModesRequest
    | ExistenceBandsRequest
    | ResonancesRequest
    | PeriodicMotionsRequest
    | AttractorsRequest
    | TimeHistoryRequest
    | SlowFlowRequest
)
"""What a sweep computes at every point."""

CalibratedRequest = (
    NaturalFrequenciesRequest | ImpactModesRequest | TimeHistoryRequest | PeriodicMotionsRequest
)
"""What a calibration fits to measurements."""
