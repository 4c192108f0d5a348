"""Requests of computations, one for each kind; those of slow flows are in `slow_flows`."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import Field

from vibroimpact_schema.grids import (
    FrequencyBand,
    FrequencyGrid,
    FrequencyUnit,
    Times,
    frequency_unit,
)
from vibroimpact_schema.motions import (
    DriveTerm,
    Initial,
    Initials,
    Limiter,
    MotionLoad,
    Sequence,
    SequenceImpact,
    SequenceStart,
)
from vibroimpact_schema.systems import AnySystem, System
from vibroimpact_schema.values import Count, Document, Index, Indices, Number, Numbers, Positive


class ComputationRequest(Document):
    """Fields of the requests of all kinds."""

    system: System
    tolerance: Positive | None = Field(
        None,
        description="Relative error allowed; absent: what double precision gives. The error of the "
        "result says what keeps it.",
    )

    def with_system(self, system: AnySystem) -> Self:
        """Return the same request about another structure."""
        return self.model_copy(update={"system": system})


Derivatives = Annotated[
    list[Annotated[str, Field(pattern=r"^[A-Za-z0-9_]+(\.[A-Za-z0-9_]+)*$", max_length=200)]],
    Field(min_length=1, max_length=1000, fail_fast=True),
]
_DERIVATIVES = (
    "Paths of numbers of the request by which all outputs are differentiated, as sweeps name them: "
    "names of fields, keys and indices from 0, separated by dots, such as "
    "system.constraints.0.gap or system.K.0.1, with which the symmetric entry changes too; or "
    "system.M.scale, system.K.scale and system.C.scale, a factor of the whole matrix"
)


NaturalFrequenciesOutput = Literal[
    "Omega", "shape", "participation", "effective_mass", "residual_flexibility"
]


class NaturalFrequenciesRequest(ComputationRequest):
    """Natural frequencies and mode shapes of the structure between its stops, without damping.

    The lowest ones, by their number or up to a frequency; that none is missing is proved.
    """

    count: Count | None = Field(
        None,
        description="Number of modes, from the lowest; of a structure with fewer, all. Absent: 10, "
        "or all up to stop.",
    )
    stop: Positive | None = Field(
        None, description="Instead of count: the frequency up to which all modes are returned."
    )
    unit: FrequencyUnit = frequency_unit(
        "Meaning of stop: Omega, a natural angular frequency; Hz and rpm, the same divided by "
        "2 pi, as in grids of frequencies; omega, times 2/pi."
    )
    fixed: Indices = Field(
        default_factory=list,
        description="Indices of the constraints whose coordinates are held at zero.",
    )
    directions: (
        Annotated[list[Numbers], Field(min_length=1, max_length=1000, fail_fast=True)] | None
    ) = Field(
        None,
        description="Displacements of all degrees of freedom by unit motions of the base, a list "
        "for each direction [direction, dof], for effective_mass; absent: the influence of the "
        "system.",
        examples=[[[1.0, 0.0, 1.0, 0.0]]],
    )
    outputs: Annotated[list[NaturalFrequenciesOutput], Field(min_length=1, fail_fast=True)] = Field(
        ["Omega", "shape", "participation"],
        description="Outputs; only these are computed, Omega always. "
        "Omega: natural angular frequencies [mode] (1/time); "
        "shape: mode shapes of unit modal mass [mode, dof] (1/√mass); "
        "participation: the constrained coordinates of the shapes [mode, constraint] (1/√mass); "
        "effective_mass: effective modal masses of motions of the base [mode, direction] (mass); "
        "residual_flexibility: static flexibility of all modes that are left out, of a free "
        "structure that of its elastic modes [constraint, constraint] (time² / mass).",
    )
    derivatives: Derivatives | None = Field(
        None,
        description=f"{_DERIVATIVES}; absent: none.",
        examples=[["system.K.scale"]],
    )


ImpactModesOutput = Literal[
    "impulse", "exists", "reason", "shape", "waveform", "energy", "stability", "harmonics"
]


class ImpactModesRequest(ComputationRequest):
    """Impact modes: periodic motions with one impact per half period at every active limiter.

    At each frequency there is one solution of the family, admissible or phantom.
    """

    frequency: FrequencyGrid
    active: Annotated[Indices, Field(min_length=1)] | None = Field(
        None, description="Indices of the constraints with impacts; absent: all."
    )
    dofs: Annotated[Indices, Field(min_length=1)] | None = Field(
        None, description="Degrees of freedom of shape and waveform; absent: all."
    )
    tau: (
        Annotated[list[Annotated[Number, Field(ge=-1, le=1)]], Field(min_length=1, fail_fast=True)]
        | None
    ) = Field(
        None,
        description="Triangle-wave times of the waveform, -1 to 1; required for waveform.",
    )
    outputs: Annotated[list[ImpactModesOutput], Field(min_length=1, fail_fast=True)] = Field(
        ["impulse", "exists", "reason"],
        description="Outputs; only these are computed. "
        "impulse: the impulse parameter p [frequency, constraint] (mass length / time²) and the "
        "momentum exchanged at each impact, 2 p/omega (mass length / time); "
        "exists, reason: whether the solution is admissible, and if not, why [frequency]; "
        "shape: x at tau = 1 [frequency, dof] (length); "
        "waveform: x at tau [frequency, tau, dof] (length); "
        "energy [frequency] (mass length² / time²); "
        "stability: spectral radius of the half-period map, the growth of the fastest "
        "deviation per half period, and whether it is 1 within its error, so that none is known to "
        "grow [frequency]; "
        "harmonics: Fourier amplitudes [frequency, harmonic, dof] (length).",
    )
    derivatives: Derivatives | None = Field(
        None,
        description=f"{_DERIVATIVES}; or frequency, the fundamental frequency Omega of each "
        "solution; absent: none.",
        examples=[["system.constraints.0.gap", "frequency"]],
    )


ExistenceBandsOutput = Literal["bands", "rejected", "stability"]


class ExistenceBandsRequest(ComputationRequest):
    """Ranges of frequency in which impact modes are admissible motions of the structure.

    With impacts at one limiter, equal gaps and no load they are proved to be all. Otherwise
    solutions between all poles are examined, and the result states which width could be missed.
    """

    frequency: FrequencyBand
    active: Annotated[Indices, Field(min_length=1)] | None = Field(
        None, description="Indices of the constraints with impacts; absent: all."
    )
    tolerance: Annotated[Number, Field(ge=1e-15, lt=0.1)] | None = Field(
        None, description="Relative accuracy of the edges; absent: 1e-12."
    )
    resolution: Annotated[Number, Field(ge=1e-6, le=0.1)] | None = Field(
        None,
        description="Width, relative to that of the range, from which on all bands and gaps are "
        "found; narrower ones only by chance, and `error.complete` is false. Absent: all of them, "
        "which takes as long as there are poles.",
    )
    outputs: Annotated[list[ExistenceBandsOutput], Field(min_length=1, fail_fast=True)] = Field(
        ["bands", "rejected"],
        description="Outputs; only these are computed. "
        "bands: where solutions are admissible; rejected: where all impulses are positive but the "
        "solutions are phantoms; stability: where in the bands deviations from "
        "solutions grow.",
    )


ResonancesOutput = Literal["Omega", "harmonic", "part"]


class ResonancesRequest(ComputationRequest):
    """Internal resonances: odd harmonics of impact modes at natural frequencies.

    These are the frequencies of the structure with the constrained coordinate held fixed.
    """

    constraint: Index = Field(0, description="Index of the constraint with impacts.")
    odd_max: Annotated[int, Field(strict=True, ge=1, le=9999)] = Field(
        9, description="Highest odd harmonic."
    )
    outputs: Annotated[list[ResonancesOutput], Field(min_length=1, fail_fast=True)] = Field(
        ["Omega", "harmonic", "part"], description="Outputs, each [resonance]."
    )


TimeHistoryOutput = Literal["x", "v", "a", "impacts", "energy", "contacts", "force"]


TimeHistoryMethod = Literal["exact", "RK45", "RK23", "DOP853", "Radau", "BDF", "LSODA"]


class MotionRequest(ComputationRequest):
    """Fields of the requests of motions from initial states."""

    t_end: Positive = Field(description="Length of the motion.")
    t: Times | None = Field(
        None, description="Output times, ascending; required for x, v, a and energy."
    )
    dofs: Annotated[Indices, Field(min_length=1)] | None = Field(
        None, description="Degrees of freedom of x, v and a; absent: all."
    )
    load: Annotated[list[MotionLoad], Field(fail_fast=True)] | None = Field(
        None,
        description="Loads in addition to the constant one of the system: harmonic, sampled, or "
        "by a moving base.",
    )
    limiter: Limiter | None = Field(None, description="Force law of the limiters; absent: rigid.")
    method: TimeHistoryMethod = Field(
        "exact",
        description="exact, or an integrator of scipy for comparison, which can miss impacts.",
    )
    outputs: Annotated[list[TimeHistoryOutput], Field(min_length=1, fail_fast=True)] = Field(
        ["impacts"], description="Outputs; only these are computed."
    )


class TimeHistoryRequest(MotionRequest):
    """Time history: the motion from an initial state, with every impact.

    Between impacts the motion is exact; tolerance is relative to the size of the motion, and the
    result states until when it can hold.
    """

    initial: Initial | None = Field(
        None, description="The state at t = 0; absent: at rest, with all displacements zero."
    )
    digits: Annotated[int, Field(strict=True, ge=17, le=1000)] | None = Field(
        None,
        description="Decimal digits of the arithmetic where double precision cannot hold the "
        "tolerance to the end; absent: the result states until when it can.",
    )
    outputs: Annotated[list[TimeHistoryOutput], Field(min_length=1, fail_fast=True)] = Field(
        ["impacts"],
        description="Outputs; only these are computed. "
        "x, v, a: displacement, velocity and acceleration [time, dof], this between impacts, of "
        "rigid stops and linear ones in double precision; "
        "impacts: a table of all impacts; "
        "energy: kinetic and elastic energy and that of the constant load [time]; "
        "contacts: a table of the times at which coordinates rest at rigid walls, or at which "
        "stops of finite stiffness push, with impulse, largest force, indentation and loss; "
        "force: the forces of stops of finite stiffness [time, constraint].",
    )
    derivatives: Derivatives | None = Field(
        None,
        description=f"{_DERIVATIVES}; or initial.x.0, load.0.amplitude and other numbers of the "
        "motion. Between rigid stops; absent: none.",
        examples=[["system.constraints.0.gap", "load.0.amplitude"]],
    )


class EnsembleRequest(MotionRequest):
    """Ensemble: the motions of one structure from many initial states.

    A member that starts outside of the limits has no motion, as its status says; the others are
    computed. To vary anything else, use a sweep.
    """

    initial: Initials
    outputs: Annotated[list[TimeHistoryOutput], Field(min_length=1, fail_fast=True)] = Field(
        ["impacts"],
        description="Outputs; only these are computed. "
        "x, v, a: displacement, velocity and acceleration [member, time, dof]; "
        "impacts, contacts: tables of all members, concatenated; "
        "energy: kinetic and elastic energy and that of the constant load [member, time].",
    )


PeriodicMotionsOutput = Literal[
    "exists", "extremes", "energy", "stability", "multipliers", "waveform"
]


def _all_outputs(given: dict[str, Any]) -> list[PeriodicMotionsOutput]:
    """Return the outputs that are possible with the other fields of a request."""
    always: list[PeriodicMotionsOutput] = ["exists", "extremes", "energy", "multipliers"]
    return always if given.get("tau") is None else [*always, "waveform"]


class PeriodicMotionsRequest(ComputationRequest):
    """Periodic motions of a driven, damped structure with a given sequence of impacts.

    At each frequency of the drive: the motion without impacts, and all motions with one impact per
    period, or with one at each wall half a period apart; longer sequences as far as a search finds
    them. With stops of finite stiffness contacts stand for impacts. Motions that are not
    admissible are listed too, with the reason.
    """

    load: Annotated[list[DriveTerm], Field(max_length=1000, fail_fast=True)] = Field(
        default_factory=list,
        description="The drive, in addition to the constant load of the system; empty: free "
        "motions of a structure without losses.",
    )
    frequency: FrequencyGrid = Field(description="Frequencies of the drive.")
    periods: Annotated[int, Field(strict=True, ge=1, le=1000)] = Field(
        1, description="Periods of the drive in one period of the motion."
    )
    sequence: Sequence = Field(
        [SequenceImpact(constraint=0, side="upper")],
        description="Impacts of one period in their order; or symmetric: one at each wall of a "
        "constraint with equal gaps, the second half of the period mirroring the first. Of stops "
        "of finite stiffness the contacts, in the order in which they begin. Absent: one impact "
        "at the upper wall of constraint 0.",
    )
    constraint: Index = Field(0, description="Constraint struck by a symmetric motion.")
    start: SequenceStart | None = Field(
        None,
        description="Where the search for several impacts per period begins; absent: at phases "
        "drawn at random, the same for every request.",
    )
    dofs: Annotated[Indices, Field(min_length=1)] | None = Field(
        None, description="Degrees of freedom of extremes and waveform; absent: all."
    )
    tau: (
        Annotated[list[Annotated[Number, Field(ge=0, le=1)]], Field(min_length=1, fail_fast=True)]
        | None
    ) = Field(
        None,
        description="Times t/T of the waveform, 0 to 1, from the drive's phase 0; required for "
        "waveform.",
    )
    outputs: Annotated[list[PeriodicMotionsOutput], Field(min_length=1, fail_fast=True)] = Field(
        default_factory=_all_outputs,
        description="What is computed beside the solutions and their impacts; absent: all, "
        "waveform where tau is given. "
        "exists: whether solutions are admissible, and why not; "
        "extremes: largest, smallest and root-mean-square displacements [solution, dof]; "
        "energy: work of the load and energy lost per period; "
        "stability: the largest modulus of the Floquet multipliers, and whether it is 1 within its "
        "error; multipliers: all of them too; "
        "waveform: x at tau [solution, tau, dof].",
    )


AttractorsOutput = Literal["section", "stability"]


class AttractorsRequest(ComputationRequest):
    """Attractors: what the motions of a driven structure with stops settle on.

    From each initial state the motion is computed for settle + observe periods of the drive. Those
    that settle on the same attractor are counted. Motions start at the drive's phase 0.
    """

    tolerance: Annotated[Number, Field(ge=1e-12, le=1e-2)] | None = Field(
        None, description="Distance of equal states relative to the amplitude; absent: 1e-6."
    )
    load: Annotated[list[DriveTerm], Field(min_length=1, max_length=1000, fail_fast=True)] = Field(
        description="The drive, in addition to the constant load of the system."
    )
    frequency: FrequencyGrid = Field(description="Frequency of the drive: one value.")
    initial: Initials
    settle: Annotated[int, Field(strict=True, ge=0, le=1_000_000)] = Field(
        200, description="Periods of the drive that are left out."
    )
    observe: Annotated[int, Field(strict=True, ge=8, le=1_000_000)] = Field(
        400,
        description="Periods of the drive that are looked at after them; at least twice longest.",
    )
    longest: Annotated[int, Field(strict=True, ge=1, le=1000)] = Field(
        16, description="Largest period, in periods of the drive, that is recognised."
    )
    section: Literal["phase", "impacts"] = Field(
        "phase",
        description="Points of the section: states at the drive's phase 0, or impacts; with stops "
        "of finite stiffness, where contacts begin.",
    )
    points: Annotated[int, Field(strict=True, ge=1, le=1_000_000)] = Field(
        200, description="Most points of the section of each attractor."
    )
    dofs: Annotated[Indices, Field(min_length=1)] | None = Field(
        None, description="Degrees of freedom of states and sections; absent: all."
    )
    outputs: Annotated[list[AttractorsOutput], Field(min_length=1, fail_fast=True)] = Field(
        ["section", "stability"],
        description="What is computed beside the attractors, their impacts and what each motion "
        "settles on. "
        "section: points of a Poincaré section of each attractor; "
        "stability: periodic attractors confirmed by Newton's method, with their multipliers.",
    )
