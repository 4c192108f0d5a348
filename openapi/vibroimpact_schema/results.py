"""The documents that results are, one per kind; arrays as nested lists."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import AwareDatetime, Field

from vibroimpact_schema.plans import Steps
from vibroimpact_schema.problems import Problem
from vibroimpact_schema.values import Digest, Document, Index

Curve = list[float]


class Provenance(Document):
    """Where a result comes from."""

    created: AwareDatetime = Field(description="When it was computed.")
    solver_version: str


class FrequencyAxis(Document):
    """The frequencies of a result, both ways."""

    Omega: Curve = Field(description="Fundamental angular frequency [frequency], 1/time.")
    omega: Curve = Field(description="Triangle-wave frequency (2/pi) Omega [frequency], 1/time.")


class Result(Document):
    """What all results share."""

    digest: Digest = Field(description="Name of the result.")
    plan: Steps
    provenance: Provenance


class ImpulseError(Document):
    """How far the numbers can be trusted."""

    impulse: list[float | None] = Field(
        description="Relative error of the impulses [frequency]; null: unknown."
    )
    condition: list[float | None] = Field(
        description="Magnification of relative roundings in the impulses [frequency]; "
        "null: unbounded."
    )
    stability: list[float | None] | None = Field(
        None,
        description="Relative error of the spectral radius [frequency]; null where there is none "
        "or it is unbounded; absent where stability was not asked for.",
    )
    within_tolerance: list[bool] | None = Field(
        None,
        description="Whether the error of the impulses is within the tolerance asked for "
        "[frequency]; absent where none was.",
    )
    statement: str = Field(description="How the errors were obtained.")


ImpactModeReason = Literal["ok", "negative_impulse", "wrong_velocity", "penetration", "singular"]


class ImpactModesResult(Result):
    """Members of a family of impact modes; outputs that were not asked for are absent."""

    kind: Literal["impact-modes"]
    frequency: FrequencyAxis
    constraint: list[Index] = Field(description="The active constraints [constraint].")
    dof: list[Index] | None = Field(None, description="The degrees of freedom [dof].")
    tau: Curve | None = Field(None, description="Triangle-wave times [tau].")
    harmonic: list[Index] | None = Field(None, description="Multiples of Omega [harmonic].")
    impulse: list[Curve] | None = Field(
        None,
        description="Impulse parameter p at the upper walls [frequency, constraint], "
        "mass length / time²; 0 where a wall is not there.",
    )
    impulse_lower: list[Curve] | None = Field(
        None,
        description="The same at the lower walls; absent where both sides are alike.",
    )
    exists: list[bool] | None = Field(
        None, description="Whether the member is a real motion [frequency]."
    )
    reason: list[ImpactModeReason] | None = Field(
        None, description="Why the member is a phantom, or ok [frequency]."
    )
    certified: list[bool] | None = Field(
        None, description="Whether that is proved, apart from rounding [frequency]."
    )
    witness: list[float | None] | None = Field(
        None,
        description="Triangle-wave time at which a limit is passed; null: none [frequency].",
    )
    shape: list[Curve] | None = Field(
        None, description="Displacement at tau = 1 [frequency, dof], length."
    )
    waveform: list[list[Curve]] | None = Field(
        None, description="Displacement [frequency, tau, dof], length."
    )
    energy: Curve | None = Field(
        None, description="Total energy [frequency], mass length² / time²."
    )
    stability: list[float | None] | None = Field(
        None,
        description="Spectral radius of the half-period map [frequency]; null where the order "
        "of simultaneous impacts decides, or the member does not exist.",
    )
    harmonics: list[list[Curve]] | None = Field(
        None,
        description="Fourier amplitudes [frequency, harmonic, dof], length: of sin(n Omega t) "
        "for odd and cos(n Omega t) for even multiples n.",
    )
    error: ImpulseError


BandEdge = Literal["range", "negative_impulse", "wrong_velocity", "penetration", "singular"]


class Band(Document):
    """A range of frequency in which members exist."""

    start: float = Field(description="Lower edge, Omega, 1/time.")
    stop: float = Field(description="Upper edge, Omega, 1/time.")
    start_reason: BandEdge = Field(
        description="What members below are, or range where none was asked for."
    )
    stop_reason: BandEdge = Field(description="What members above are.")
    edge_error: float = Field(description="Largest absolute error of the edges, 1/time.")
    certified: bool = Field(description="Whether existence is proved throughout.")


class RejectedRange(Document):
    """A range in which all impulses are positive and the members are phantoms all the same."""

    start: float
    stop: float
    reason: BandEdge
    certified: bool = Field(description="Whether that is proved throughout.")
    witness: float | None = Field(
        description="Triangle-wave time at which a limit is passed, somewhere in the range."
    )
    constraint: int = Field(description="The limit that is passed; -1: unknown.")


class StabilityRange(Document):
    """A range inside a band in which members are all stable or all unstable."""

    start: float
    stop: float
    stable: bool
    radius: float = Field(
        description="Largest spectral radius of the half-period map among the members looked at."
    )


class UnresolvedRange(Document):
    """A range that could not be decided."""

    start: float
    stop: float


class BandError(Document):
    """How far the bands can be trusted."""

    resolution: float = Field(
        description="Relative width below which a band, or a gap between bands, could hide."
    )
    statement: str = Field(description="How the bands were obtained.")


class ExistenceBandsResult(Result):
    """Bands of existence, ascending; outputs that were not asked for are absent."""

    kind: Literal["existence-bands"]
    bands: list[Band] | None = None
    rejected: list[RejectedRange] | None = None
    stability: list[StabilityRange] | None = None
    unresolved: list[UnresolvedRange] = Field(description="Empty, but in extreme cases.")
    error: BandError


class Statement(Document):
    """How far the numbers can be trusted, in words."""

    statement: str


class ResonanceError(Statement):
    """How far natural frequencies can be trusted."""

    natural: Curve = Field(description="Relative error of the natural frequency [resonance].")
    within_tolerance: list[bool] | None = Field(
        None,
        description="Whether that is within the tolerance asked for [resonance]; absent where "
        "none was.",
    )


class ResonancesResult(Result):
    """Internal resonances by ascending frequency."""

    kind: Literal["resonances"]
    Omega: Curve | None = Field(
        None, description="Fundamental frequency of the impact mode [resonance], 1/time."
    )
    harmonic: list[Index] | None = Field(
        None, description="Odd multiple of Omega that resonates [resonance]."
    )
    part: list[Index] | None = Field(
        None,
        description="Which part of the structure, as it falls apart when the coordinate is held, "
        "counted from the lowest degree of freedom [resonance].",
    )
    natural: Curve = Field(
        description="Natural frequency of the held structure [resonance], 1/time."
    )
    error: ResonanceError


Side = Literal[-1, 1]


class Impacts(Document):
    """All impacts in order, one column each [impact]."""

    time: Curve = Field(description="Time of the impact.")
    constraint: list[Index] = Field(description="Index of the constraint.")
    side: list[Side] = Field(description="Wall: 1 the upper, -1 the lower one.")
    velocity: Curve = Field(description="Velocity of the coordinate before it, length / time.")
    impulse: Curve = Field(description="Impulse on the structure, mass length / time.")
    condition: list[float | None] = Field(
        description="Estimated error of the state relative to it, in units of the rounding 2^-52."
    )


class Contacts(Document):
    """When constrained coordinates rest at their walls, one column each [contact]."""

    start: Curve = Field(
        description="Time of the last impact listed before it; what follows until the rest is "
        "infinitely many impacts, summed."
    )
    rest: Curve = Field(description="Time at which the coordinate comes to rest.")
    stop: Curve = Field(description="Time of release, or the end of the motion.")
    constraint: list[Index] = Field(description="Index of the constraint.")
    side: list[Side] = Field(description="Wall: 1 the upper, -1 the lower one.")
    impulse: Curve = Field(
        description="Impulse of the wall on the structure from rest to stop, mass length / time: "
        "the integral of the contact force."
    )


class Count(Document):
    """How many of what."""

    impacts: Index = Field(description="Impacts, without those summed in a chatter.")
    grazings: Index = Field(description="Touches of a wall without an impulse.")
    expansions: Index = Field(description="Expansions that the search for impacts took.")


class MotionError(Document):
    """How far the numbers can be trusted."""

    condition: float = Field(
        description="Largest error of the state relative to it, in units of the rounding 2^-52."
    )
    penetration: float = Field(
        description="Largest distance between a wall and the place of an impact at it, length."
    )
    predictable_until: float = Field(
        description="Time until which the tolerance can hold with the digits computed with; "
        "t_end if it holds to the end."
    )
    tolerance: float = Field(description="The tolerance meant.")
    energy_drift: float | None = Field(
        None, description="Largest relative change of the energy, where it is conserved and asked."
    )
    difference: float | None = Field(
        None,
        description="Difference to the same motion with steps of twice the length, relative to "
        "the largest state; absent where nothing steps.",
    )
    digits: Index | None = Field(
        None,
        description="Decimal digits that were computed with; absent: double precision held the "
        "tolerance, or no more was asked for.",
    )
    statement: str = Field(description="How the errors were obtained.")


class TimeHistoryResult(Result):
    """A motion; outputs that were not asked for are absent."""

    kind: Literal["time-history"]
    t: Curve | None = Field(None, description="Times [time].")
    dof: list[Index] | None = Field(None, description="The degrees of freedom [dof].")
    x: list[Curve] | None = Field(None, description="Displacement [time, dof], length.")
    v: list[Curve] | None = Field(None, description="Velocity [time, dof], length / time.")
    energy: Curve | None = Field(
        None,
        description="Kinetic and elastic energy and that of the constant load [time], "
        "mass length² / time².",
    )
    impacts: Impacts | None = Field(None, description="Table of impacts.")
    contacts: Contacts | None = Field(None, description="Table of contacts.")
    count: Count
    error: MotionError


class MemberCounts(Document):
    """How many of what, in each motion."""

    impacts: list[Index] = Field(description="Impacts [member], without those summed in a chatter.")
    grazings: list[Index] = Field(description="Touches of a wall without an impulse [member].")
    expansions: list[Index] = Field(
        description="Expansions that the search for impacts took [member]."
    )


class EnsembleError(Document):
    """How far the numbers can be trusted; null where a member has no motion."""

    condition: list[float | None] = Field(
        description="Largest error of the state relative to it, in units of the rounding 2^-52 "
        "[member]."
    )
    penetration: list[float | None] = Field(
        description="Largest distance between a wall and the place of an impact at it [member], "
        "length."
    )
    predictable_until: list[float | None] = Field(
        description="Time until which the tolerance can hold in double precision [member]."
    )
    energy_drift: list[float | None] | None = Field(
        None,
        description="Largest relative change of the energy [member], where it is conserved and "
        "asked.",
    )
    difference: list[float | None] | None = Field(
        None,
        description="Difference to the same motion with steps of twice the length [member]; "
        "absent where nothing steps.",
    )
    tolerance: float = Field(description="The tolerance meant.")
    statement: str = Field(description="How the errors were obtained.")
    failures: list[str] = Field(description="Why members have no motion: the first of them.")


MemberStatus = Literal["ok", "invalid", "not_possible", "no_convergence"]


class EnsembleResult(Result):
    """The motions from many initial states; outputs that were not asked for are absent.

    Tables of all members are joined in their order; ``<table>_count`` and ``<table>_offset``
    tell how many rows each member has and which is its first. Members without a motion have
    null in the arrays.
    """

    kind: Literal["ensemble"]
    member: list[Index] = Field(description="Indices of the initial states [member].")
    status: list[MemberStatus] = Field(
        description="Whether there is a motion, and if not why [member]."
    )
    t: Curve | None = Field(None, description="Times [time].")
    dof: list[Index] | None = Field(None, description="The degrees of freedom [dof].")
    x: list[list[list[float | None]]] | None = Field(
        None, description="Displacement [member, time, dof], length."
    )
    v: list[list[list[float | None]]] | None = Field(
        None, description="Velocity [member, time, dof], length / time."
    )
    energy: list[list[float | None]] | None = Field(
        None,
        description="Kinetic and elastic energy and that of the constant load [member, time], "
        "mass length² / time².",
    )
    impact_count: list[Index] | None = Field(None, description="Rows of impacts [member].")
    impact_offset: list[Index] | None = Field(None, description="First row of impacts [member].")
    impacts: Impacts | None = Field(None, description="Impacts of all members.")
    contact_count: list[Index] | None = Field(None, description="Rows of contacts [member].")
    contact_offset: list[Index] | None = Field(None, description="First row of contacts [member].")
    contacts: Contacts | None = Field(None, description="Contacts of all members.")
    count: MemberCounts
    error: EnsembleError


class SlowFlowImpacts(Document):
    """The impacts of the exact motion."""

    time: Curve = Field(description="Times [impact].")
    velocity: Curve = Field(description="Speed before each [impact], length / time.")


class SlowFlowError(Document):
    """How far a variant is from the exact motion, and what it took."""

    x: list[Curve] | None = Field(
        None, description="Displacement less the exact one [time, dof], length."
    )
    gamma: list[float | None] | None = Field(
        None,
        description="Frequency ratio less the exact one at the impacts [impact]; null after the "
        "variant's last impact.",
    )
    phi: list[float | None] | None = Field(
        None,
        description="Phase less the exact one at the impacts [impact]; null after the variant's "
        "last impact.",
    )
    seconds: float = Field(description="Time that the variant took, s.")
    seconds_exact: float | None = Field(None, description="Time that the exact motion took, s.")
    within_tolerance: bool | None = Field(
        None,
        description="Whether the largest error of the displacement, relative to the largest "
        "displacement, is within the tolerance asked for; absent where none was.",
    )
    statement: str = Field(description="How the errors were obtained.")


SlowFlowStage = Literal["impacts", "free", "rest"]


class SlowFlowResult(Result):
    """A motion whose impacts change slowly; outputs that were not asked for are absent."""

    kind: Literal["slow-flow"]
    t: Curve = Field(description="Times [time].")
    dof: list[Index] | None = Field(None, description="The degrees of freedom [dof].")
    impact: list[Index] | None = Field(
        None, description="Numbers of the exact motion's impacts, from 1 [impact]."
    )
    stage: list[SlowFlowStage] = Field(description="Stage of the motion [time].")
    gamma: list[float | None] | None = Field(
        None, description="Frequency ratio Omega0/omega [time]; null after the last impact."
    )
    omega: list[float | None] | None = Field(
        None, description="Triangle-wave frequency [time], 1/time; null after the last impact."
    )
    phi: list[float | None] | None = Field(
        None, description="Phase of the triangle wave [time]; null after the last impact."
    )
    A: list[float | None] | None = Field(
        None, description="Sine amplitude of the second mass [time], length."
    )
    B: list[float | None] | None = Field(
        None, description="Cosine amplitude of the second mass [time], length."
    )
    x: list[Curve] | None = Field(None, description="Displacement [time, dof], length.")
    v: list[Curve] | None = Field(None, description="Velocity [time, dof], length / time.")
    impulse: list[float | None] | None = Field(
        None, description="Impulse parameter p [time], mass length / time²."
    )
    t_max: float | None = Field(
        description="End of the impacts by this variant, time; null: they never end."
    )
    t_max_exact: float | None = Field(
        description="End of the impacts of the exact motion, time; null: they never end."
    )
    exists: bool | None = Field(None, description="Whether a member of a family is a real motion.")
    impacts: SlowFlowImpacts | None = None
    error: SlowFlowError


class BatchAnswer(Document):
    """The answer to one request of a batch: its result, or the problem with it."""

    result: dict[str, Any] | None = Field(
        None, description="As POST /v1/compute/{kind} answers the request."
    )
    problem: Problem | None = Field(None, description="Why there is no result.")


class BatchAnswers(Document):
    """The answers to the requests of a batch, in their order."""

    answers: list[BatchAnswer]
