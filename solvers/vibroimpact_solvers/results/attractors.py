"""Attractors: what the motions of a driven structure settle on, and how many of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Any, ClassVar, Final

from vibroimpact_solvers.arrays import Booleans, Floats, Group, Integers, Quantity
from vibroimpact_solvers.errors import STATUSES
from vibroimpact_solvers.results.contacts import (
    ContactConstraint,
    ContactDuration,
    ContactPhase,
    ContactSide,
    ContactVelocity,
    contact,
)
from vibroimpact_solvers.results.shared import NEUTRAL, NO_YES, Dofs, Statement


class Nature(IntEnum):
    """What motions settle on."""

    PERIODIC = 0
    QUASI_PERIODIC = 1
    CHAOTIC = 2
    UNDECIDED = 3


class Verification(IntEnum):
    """Whether Newton's method confirms a periodic attractor, and why not."""

    CONFIRMED = 0
    NOT_PERIODIC = 1
    RESTS = 2
    TOO_LONG = 3
    NOT_REACHED = 4
    UNSTABLE = 5


NATURES: Final = tuple(nature.name.lower().replace("_", "-") for nature in Nature)
VERIFICATIONS: Final = tuple(value.name.lower() for value in Verification)


def _attractor(column: str, unit: str, long_name: str, *dims: str, **rest: Any) -> Quantity:
    """Return the declaration of a column of the table of attractors."""
    return Quantity(("attractor", *dims), unit, long_name, path=f"attractor/{column}", **rest)


def _impact(column: str, unit: str, long_name: str, **rest: Any) -> Quantity:
    return Quantity(("impact",), unit, long_name, path=f"impact/{column}", **rest)


def _section(column: str, unit: str, long_name: str, *dims: str, **rest: Any) -> Quantity:
    return Quantity(("section", *dims), unit, long_name, path=f"section/{column}", **rest)


def _settled(column: str, unit: str, long_name: str, **rest: Any) -> Quantity:
    return Quantity(("motion",), unit, long_name, path=f"settled/{column}", **rest)


def _error(of: str, unit: str, long_name: str, *dims: str, **rest: Any) -> Quantity:
    return Quantity(dims, unit, f"error of the {long_name}", path=f"error/{of}", **rest)


_EXPONENT: Final = "largest Lyapunov exponent"
_NONE: Final = "it rests at a wall, or the attractor is undecided"


@dataclass(frozen=True, eq=False)
class Result:
    """Attractors in the order in which motions first settle on them; sections where requested."""

    GROUPS: ClassVar[Mapping[str, Group]] = {
        "attractor": Group(
            "Attractors", "One row for each attractor; all undecided motions are one row.", False
        ),
        "impact": Group("AttractorImpacts", "The impacts of one period of periodic attractors."),
        "contact": Group(
            "AttractorContacts",
            "The contact phases of one period of periodic attractors, with stops of finite "
            "stiffness.",
            False,
        ),
        "section": Group("AttractorSections", "Points of the sections of attractors.", False),
        "settled": Group("SettledMotions", "What each motion settles on."),
        "error": Group("AttractorError", "Errors of the outputs."),
        "error/attractor": Group("AttractorErrors", "Errors of columns of the attractors.", False),
        "error/section": Group("AttractorSectionErrors", "Errors of points of sections.", False),
        "error/impact": Group("AttractorImpactErrors", "Errors of columns of the impacts."),
        "error/contact": Group(
            "AttractorContactErrors", "Errors of columns of the contact phases.", False
        ),
        "error/settled": Group("SettledErrors", "Errors of columns of the motions."),
    }

    Omega: Annotated[float, Quantity((), "time-1", "frequency of the drive")]
    dof: Dofs
    motion: Annotated[Integers, Quantity(("motion",), "1", "index of the initial state", True)]
    settled_status: Annotated[
        Integers, _settled("status", "1", "whether there is a motion, or why not", flags=STATUSES)
    ]
    settled_attractor: Annotated[
        Integers,
        _settled("attractor", "1", "row of its attractor, -1 where it has none", integers=()),
    ]
    settled_period: Annotated[
        Integers, _settled("period", "1", "period in periods of the drive, 0 of no periodic one")
    ]
    settled_exponent: Annotated[
        Floats,
        _settled("exponent", "time-1", _EXPONENT, error="error/settled/exponent",
                 missing="it rests at a wall, or there is no motion"),
    ]  # fmt: skip
    attractor_nature: Annotated[
        Integers, _attractor("nature", "1", "what it is, as far as is decided", flags=NATURES)
    ]
    attractor_period: Annotated[
        Integers, _attractor("period", "1", "period in periods of the drive, 0 of no periodic one")
    ]
    attractor_impacts: Annotated[
        Integers, _attractor("impacts", "1", "impacts in one period of a periodic one, else 0")
    ]
    attractor_impact_rate: Annotated[
        Floats,
        _attractor(
            "impact_rate",
            "1",
            "mean number of impacts per period of the drive",
            error="error/attractor/impact_rate",
        ),
    ]
    attractor_contacts: Annotated[
        Integers | None,
        _attractor(
            "contacts", "1", "contact phases in one period of a periodic one, else 0",
            note="of stops of finite stiffness",
        ),
    ]  # fmt: skip
    attractor_contact_rate: Annotated[
        Floats | None,
        _attractor(
            "contact_rate", "1", "mean number of contact phases per period of the drive",
            error="error/attractor/contact_rate", note="of stops of finite stiffness",
        ),
    ]  # fmt: skip
    attractor_rests: Annotated[
        Booleans, _attractor("rests", "1", "whether it rests at walls for a while", flags=NO_YES)
    ]
    attractor_exponent: Annotated[
        Floats,
        _attractor("exponent", "time-1", _EXPONENT, error="error/attractor/exponent",
                   missing=_NONE),
    ]  # fmt: skip
    attractor_motions: Annotated[
        Integers, _attractor("motions", "1", "number of motions that settle on it")
    ]
    attractor_fraction: Annotated[
        Floats,
        _attractor("fraction", "1", "part of the motions that settle on it",
                   error="error/attractor/fraction"),
    ]  # fmt: skip
    attractor_fraction_low: Annotated[
        Floats, _attractor("fraction_low", "1", "lower end of the interval of 95 % of the fraction")
    ]
    attractor_fraction_high: Annotated[
        Floats,
        _attractor("fraction_high", "1", "upper end of the interval of 95 % of the fraction"),
    ]
    attractor_x: Annotated[
        Floats,
        _attractor("x", "length", "displacement at the drive's phase 0", "dof",
                   error="error/attractor/x"),
    ]  # fmt: skip
    attractor_v: Annotated[
        Floats,
        _attractor("v", "length time-1", "velocity at the drive's phase 0", "dof",
                   error="error/attractor/v"),
    ]  # fmt: skip
    attractor_verification: Annotated[
        Integers | None,
        _attractor("verification", "1", "whether Newton's method confirms a periodic one, or why "
                   "not", flags=VERIFICATIONS),
    ]  # fmt: skip
    attractor_stability: Annotated[
        Floats | None,
        _attractor("stability", "1", "largest modulus of the multipliers over one period",
                   error="error/attractor/stability", missing="not confirmed"),
    ]  # fmt: skip
    attractor_neutral: Annotated[Booleans | None, _attractor("neutral", "1", NEUTRAL, flags=NO_YES)]
    impact_attractor: Annotated[Integers, _impact("attractor", "1", "row of its attractor")]
    impact_constraint: Annotated[
        Integers, _impact("constraint", "1", "index of the constraint struck")
    ]
    impact_side: Annotated[
        Integers, _impact("side", "1", "wall: 1 the upper, -1 the lower one", integers=(1, -1))
    ]
    impact_phase: Annotated[
        Floats,
        _impact("phase", "1", "phase of the drive, Omega t modulo 2 pi",
                error="error/impact/phase"),
    ]  # fmt: skip
    impact_time: Annotated[
        Floats,
        _impact("time", "time", "time in the period of the attractor, which begins with x and v",
                error="error/impact/time"),
    ]  # fmt: skip
    impact_momentum: Annotated[
        Floats,
        _impact("momentum", "mass length time-1", "magnitude of the momentum exchanged",
                error="error/impact/momentum"),
    ]  # fmt: skip
    impact_velocity: Annotated[
        Floats,
        _impact("velocity", "length time-1", "velocity of the coordinate before the impact",
                error="error/impact/velocity"),
    ]  # fmt: skip
    contact_attractor: Annotated[Integers | None, contact("attractor", "1", "row of its attractor")]
    contact_constraint: ContactConstraint
    contact_side: ContactSide
    contact_phase: ContactPhase
    contact_time: Annotated[
        Floats | None,
        contact(
            "time", "time",
            "time of its beginning in the period of the attractor, which begins with x and v",
            error="error/contact/time",
        ),
    ]  # fmt: skip
    contact_duration: ContactDuration
    contact_impulse: Annotated[
        Floats | None,
        contact(
            "impulse", "mass length time-1", "integral of the force of the stop",
            error="error/contact/impulse",
        ),
    ]  # fmt: skip
    contact_peak_force: Annotated[
        Floats | None,
        contact(
            "peak_force", "mass length time-2", "largest force of the stop",
            error="error/contact/peak_force",
        ),
    ]  # fmt: skip
    contact_velocity: ContactVelocity
    contact_indentation: Annotated[
        Floats | None,
        contact(
            "indentation", "length", "largest distance beyond the wall",
            error="error/contact/indentation",
        ),
    ]  # fmt: skip
    contact_start_indentation: Annotated[
        Floats | None,
        contact(
            "start_indentation", "length", "distance beyond the wall at its beginning",
            note="positive where a stop with damping pushes again before its wall is left",
            missing="not confirmed, or the stop is loaded throughout",
            error="error/contact/start_indentation",
        ),
    ]  # fmt: skip
    contact_energy_lost: Annotated[
        Floats | None,
        contact(
            "energy_lost", "mass length2 time-2", "energy that the contact loses",
            error="error/contact/energy_lost",
        ),
    ]  # fmt: skip
    section_attractor: Annotated[
        Integers | None, _section("attractor", "1", "row of its attractor")
    ]
    section_x: Annotated[
        Floats | None,
        _section(
            "x", "length", "displacement at the drive's phase 0", "dof", error="error/section/x"
        ),
    ]
    section_v: Annotated[
        Floats | None,
        _section(
            "v", "length time-1", "velocity at the drive's phase 0", "dof", error="error/section/v"
        ),
    ]
    section_constraint: Annotated[
        Integers | None, _section("constraint", "1", "index of the constraint struck")
    ]
    section_side: Annotated[
        Integers | None,
        _section("side", "1", "wall: 1 the upper, -1 the lower one", integers=(1, -1)),
    ]
    section_phase: Annotated[
        Floats | None,
        _section(
            "phase", "1", "phase of the drive, Omega t modulo 2 pi", error="error/section/phase"
        ),
    ]
    section_velocity: Annotated[
        Floats | None,
        _section(
            "velocity",
            "length time-1",
            "velocity of the coordinate before the impact",
            error="error/section/velocity",
        ),
    ]
    error_statement: Statement
    error_failures: Annotated[
        list[str],
        Quantity((), "1", "why there are no motions, the first of them", path="error/failures"),
    ]
    error_undecided: Annotated[
        list[str],
        Quantity((), "1", "why motions are undecided, the first of them, and what to ask for",
                 path="error/undecided"),
    ]  # fmt: skip
    error_settled_exponent: Annotated[
        Floats, _error("settled/exponent", "time-1", _EXPONENT, "motion", missing="none")
    ]
    error_attractor_exponent: Annotated[
        Floats, _error("attractor/exponent", "time-1", _EXPONENT, "attractor", missing="none")
    ]
    error_impact_rate: Annotated[
        Floats, _error("attractor/impact_rate", "1", "mean number of impacts", "attractor")
    ]
    error_contact_rate: Annotated[
        Floats | None,
        _error("attractor/contact_rate", "1", "mean number of contact phases", "attractor"),
    ]
    error_fraction: Annotated[Floats, _error("attractor/fraction", "1", "fraction", "attractor")]
    error_x: Annotated[
        Floats,
        _error("attractor/x", "length", "displacement", "attractor", "dof", missing="not periodic"),
    ]
    error_v: Annotated[
        Floats,
        _error("attractor/v", "length time-1", "velocity", "attractor", "dof",
               missing="not periodic"),
    ]  # fmt: skip
    error_stability: Annotated[
        Floats | None,
        _error("attractor/stability", "1", "largest modulus", "attractor", missing="none"),
    ]
    error_section_x: Annotated[
        Floats | None,
        _error("section/x", "length", "displacement", "section", "dof", missing="not periodic"),
    ]
    error_section_v: Annotated[
        Floats | None,
        _error("section/v", "length time-1", "velocity", "section", "dof", missing="not periodic"),
    ]
    error_section_phase: Annotated[
        Floats | None, _error("section/phase", "1", "phase", "section", missing="not periodic")
    ]
    error_section_velocity: Annotated[
        Floats | None,
        _error("section/velocity", "length time-1", "velocity", "section", missing="not periodic"),
    ]
    error_phase: Annotated[
        Floats, _error("impact/phase", "1", "phase", "impact", missing="not confirmed")
    ]
    error_time: Annotated[
        Floats, _error("impact/time", "time", "time", "impact", missing="not confirmed")
    ]
    error_momentum: Annotated[
        Floats,
        _error("impact/momentum", "mass length time-1", "momentum", "impact",
               missing="not confirmed"),
    ]  # fmt: skip
    error_velocity: Annotated[
        Floats,
        _error("impact/velocity", "length time-1", "velocity", "impact", missing="not confirmed"),
    ]
    error_contact_phase: Annotated[
        Floats | None,
        _error("contact/phase", "1", "phase", "contact", missing="not confirmed"),
    ]
    error_contact_time: Annotated[
        Floats | None,
        _error("contact/time", "time", "time", "contact", missing="not confirmed"),
    ]
    error_contact_duration: Annotated[
        Floats | None,
        _error("contact/duration", "time", "duration", "contact", missing="not confirmed"),
    ]
    error_contact_impulse: Annotated[
        Floats | None,
        _error(
            "contact/impulse", "mass length time-1", "impulse", "contact", missing="not confirmed"
        ),
    ]
    error_contact_peak_force: Annotated[
        Floats | None,
        _error(
            "contact/peak_force", "mass length time-2", "force", "contact", missing="not confirmed"
        ),
    ]
    error_contact_velocity: Annotated[
        Floats | None,
        _error("contact/velocity", "length time-1", "velocity", "contact", missing="not confirmed"),
    ]
    error_contact_indentation: Annotated[
        Floats | None,
        _error("contact/indentation", "length", "indentation", "contact", missing="not confirmed"),
    ]
    error_contact_start_indentation: Annotated[
        Floats | None,
        _error(
            "contact/start_indentation", "length", "indentation", "contact", missing="not confirmed"
        ),
    ]
    error_contact_energy_lost: Annotated[
        Floats | None,
        _error(
            "contact/energy_lost",
            "mass length2 time-2",
            "energy",
            "contact",
            missing="not confirmed",
        ),
    ]
