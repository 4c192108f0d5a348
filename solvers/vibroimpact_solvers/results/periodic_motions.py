"""Periodic motions of driven structures: a table of solutions, and one of their impacts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Any, ClassVar, Final

from vibroimpact_solvers.arrays import Booleans, Floats, Group, Integers, Quantity
from vibroimpact_solvers.results.contacts import (
    ContactConstraint,
    ContactDuration,
    ContactPhase,
    ContactSide,
    ContactVelocity,
    contact,
)
from vibroimpact_solvers.results.impact_modes import REASONS
from vibroimpact_solvers.results.shared import EXISTS, NEUTRAL, NO_YES, ONE, WITHIN, Dofs, Statement


class Bifurcation(IntEnum):
    """How the multiplier that leaves the unit circle farthest does so."""

    NONE = 0
    FOLD = 1
    FLIP = 2
    TORUS = 3


BIFURCATIONS: Final = tuple(kind.name.lower() for kind in Bifurcation)


def _solution(column: str, unit: str, long_name: str, *dims: str, **rest: Any) -> Quantity:
    """Return the declaration of a column of the table of solutions."""
    return Quantity(("solution", *dims), unit, long_name, path=f"solution/{column}", **rest)


def _impact(column: str, unit: str, long_name: str, **rest: Any) -> Quantity:
    return Quantity(("impact",), unit, long_name, path=f"impact/{column}", **rest)


def _error(of: str, unit: str, long_name: str, *dims: str, **rest: Any) -> Quantity:
    """Return the declaration of the error of a column, such as ``"impact/phase"``."""
    return Quantity(dims, unit, f"error of the {long_name}", path=f"error/{of}", **rest)


_ALL = "solution"
_UNBOUNDED: Final = {"missing": "the load drives a mode without damping at its own frequency"}
_NO_NUMBER: Final = {"missing": "there is no number"}


@dataclass(frozen=True, eq=False)
class Result:
    """Solutions by ascending index of frequency; outputs that were not requested are absent."""

    GROUPS: ClassVar[Mapping[str, Group]] = {
        "frequency": Group("DriveFrequencies", "Frequencies of the drive."),
        "solution": Group("Solutions", "One row for each periodic motion, admissible or phantom."),
        "impact": Group("SolutionImpacts", "One row for each impact of the solutions."),
        "contact": Group(
            "SolutionContacts",
            "One row for each contact phase of the solutions with stops of finite stiffness.",
        ),
        "multipliers": Group(
            "Multipliers",
            "Floquet multipliers, by descending modulus; of conjugate ones the one above first.",
        ),
        "error": Group("PeriodicMotionError", "Absolute errors of the outputs."),
        "error/solution": Group(
            "SolutionErrors", "Absolute errors of columns of the solutions.", together=False
        ),
        "error/multipliers": Group("MultiplierErrors", "Absolute errors of the multipliers."),
        "error/impact": Group(
            "ImpactErrors", "Absolute errors of columns of the impacts.", together=False
        ),
        "error/contact": Group(
            "SolutionContactErrors",
            "Absolute errors of columns of the contact phases.",
            together=False,
        ),
    }

    Omega: Annotated[
        Floats,
        Quantity(("frequency",), "time-1", "frequency of the drive", True, path="frequency/Omega"),
    ]
    complete: Annotated[
        Booleans | None,
        Quantity(
            ("frequency",), "1", "whether no motion with these impacts can be missing",
            path="frequency/complete", flags=NO_YES,
        ),
    ]  # fmt: skip
    dof: Dofs
    tau: Annotated[
        Floats | None,
        Quantity(("tau",), "1", "part of the period, from the drive's phase 0", True),
    ]
    solution_frequency_index: Annotated[
        Integers, _solution("frequency_index", "1", "index of the frequency")
    ]
    solution_Omega: Annotated[Floats, _solution("Omega", "time-1", "frequency of the drive")]
    solution_impacts: Annotated[
        Integers,
        _solution("impacts", "1", "impacts per period, 0 of the motion without any"),
    ]
    solution_contacts: Annotated[
        Integers | None,
        _solution("contacts", "1", "contact phases per period, of stops of finite stiffness"),
    ]
    solution_exists: Annotated[
        Booleans | None,
        _solution("exists", "1", "whether the solution is admissible", flags=EXISTS),
    ]
    solution_reason: Annotated[
        Integers | None,
        _solution("reason", "1", "why it is not admissible, or ok", flags=REASONS),
    ]
    solution_witness: Annotated[
        Floats | None,
        _solution(
            "witness",
            "1",
            "part of the period, from the drive's phase 0, at which it fails",
            missing="none",
        ),
    ]
    solution_witness_constraint: Annotated[
        Integers | None,
        _solution("witness_constraint", "1", "constraint at which it fails, or -1", integers=()),
    ]
    solution_certified: Annotated[
        Booleans | None,
        _solution(
            "certified", "1", "whether the verdict holds for all motions within the error",
            flags=NO_YES,
        ),
    ]  # fmt: skip
    solution_stability: Annotated[
        Floats | None,
        _solution(
            "stability", "1", "largest modulus of the multipliers over one period",
            error="error/solution/stability", missing="grazing",
        ),
    ]  # fmt: skip
    solution_neutral: Annotated[
        Booleans | None,
        _solution("neutral", "1", NEUTRAL, flags=NO_YES),
    ]
    solution_bifurcation: Annotated[
        Integers | None,
        _solution(
            "bifurcation", "1",
            "how the largest multiplier leaves the unit circle: through 1, a fold or the loss of "
            "symmetry, through -1, a flip, or as a complex pair, a torus; none where it does not",
            flags=BIFURCATIONS,
        ),
    ]  # fmt: skip
    solution_x_max: Annotated[
        Floats | None,
        _solution(
            "x_max",
            "length",
            "largest displacement",
            "dof",
            error="error/solution/x_max",
            **_UNBOUNDED,
        ),
    ]
    solution_x_min: Annotated[
        Floats | None,
        _solution(
            "x_min",
            "length",
            "smallest displacement",
            "dof",
            error="error/solution/x_min",
            **_UNBOUNDED,
        ),
    ]
    solution_rms: Annotated[
        Floats | None,
        _solution(
            "rms", "length", "root mean square of the displacement", "dof",
            error="error/solution/rms", **_UNBOUNDED,
        ),
    ]  # fmt: skip
    solution_energy_lost: Annotated[
        Floats | None,
        _solution(
            "energy_lost", "mass length2 time-2", "energy lost by damping and impacts per period",
            error="error/solution/energy_lost", **_UNBOUNDED,
        ),
    ]  # fmt: skip
    solution_energy: Annotated[
        Floats | None,
        _solution(
            "energy", "mass length2 time-2",
            "energy after the first impact, from the equilibrium under the constant load; without "
            "impacts at phase 0",
            error="error/solution/energy", **_UNBOUNDED,
        ),
    ]  # fmt: skip
    solution_work: Annotated[
        Floats | None,
        _solution(
            "work", "mass length2 time-2", "work of the load per period",
            error="error/solution/work", **_UNBOUNDED,
        ),
    ]  # fmt: skip
    solution_within_tolerance: Annotated[
        Booleans | None,
        _solution(
            "within_tolerance", "1", "whether the errors of its impulses are within the tolerance",
            flags=WITHIN,
        ),
    ]  # fmt: skip
    impact_solution: Annotated[Integers, _impact("solution", "1", "row of its solution")]
    impact_constraint: Annotated[
        Integers, _impact("constraint", "1", "index of the constraint struck")
    ]
    impact_side: Annotated[
        Integers, _impact("side", "1", "wall: 1 the upper, -1 the lower one", integers=(1, -1))
    ]
    impact_phase: Annotated[
        Floats,
        _impact(
            "phase", "1", "phase of the drive, Omega t modulo 2 pi", error="error/impact/phase"
        ),
    ]
    impact_time: Annotated[
        Floats,
        _impact(
            "time", "time", "time in the period of the motion, from the drive's phase 0",
            error="error/impact/time",
        ),
    ]  # fmt: skip
    impact_momentum: Annotated[
        Floats,
        _impact(
            "momentum", "mass length time-1",
            "momentum exchanged, positive where the wall pushes", error="error/impact/momentum",
        ),
    ]  # fmt: skip
    impact_velocity: Annotated[
        Floats,
        _impact(
            "velocity", "length time-1", "velocity of the coordinate before the impact",
            error="error/impact/velocity",
        ),
    ]  # fmt: skip
    contact_solution: Annotated[Integers | None, contact("solution", "1", "row of its solution")]
    contact_constraint: ContactConstraint
    contact_side: ContactSide
    contact_phase: ContactPhase
    contact_time: Annotated[
        Floats | None,
        contact(
            "time", "time", "time of its beginning in the period of the motion, from phase 0",
            error="error/contact/time",
        ),
    ]  # fmt: skip
    contact_duration: ContactDuration
    contact_impulse: Annotated[
        Floats | None,
        contact(
            "impulse", "mass length time-1", "integral of the force of the stop",
            error="error/contact/impulse", **_UNBOUNDED,
        ),
    ]  # fmt: skip
    contact_peak_force: Annotated[
        Floats | None,
        contact(
            "peak_force", "mass length time-2", "largest force of the stop",
            error="error/contact/peak_force", **_UNBOUNDED,
        ),
    ]  # fmt: skip
    contact_velocity: ContactVelocity
    contact_indentation: Annotated[
        Floats | None,
        contact(
            "indentation", "length", "largest distance beyond the wall",
            error="error/contact/indentation", **_UNBOUNDED,
        ),
    ]  # fmt: skip
    contact_start_indentation: Annotated[
        Floats | None,
        contact(
            "start_indentation", "length", "distance beyond the wall at its beginning",
            note="positive where a stop with damping pushes again before its wall is left",
            missing="the stop is loaded throughout", error="error/contact/start_indentation",
        ),
    ]  # fmt: skip
    contact_energy_lost: Annotated[
        Floats | None,
        contact(
            "energy_lost", "mass length2 time-2", "energy that the contact loses",
            error="error/contact/energy_lost", **_UNBOUNDED,
        ),
    ]  # fmt: skip
    multipliers_real: Annotated[
        Floats | None,
        Quantity(("solution", "multiplier"), "1", "real part", path="multipliers/real",
                 error="error/multipliers/real", missing="grazing"),
    ]  # fmt: skip
    multipliers_imaginary: Annotated[
        Floats | None,
        Quantity(("solution", "multiplier"), "1", "imaginary part", path="multipliers/imaginary",
                 error="error/multipliers/imaginary", missing="grazing"),
    ]  # fmt: skip
    waveform: Annotated[
        Floats | None,
        Quantity(
            ("solution", "tau", "dof"),
            "length",
            "displacement",
            error="error/waveform",
            **_UNBOUNDED,
        ),
    ]
    error_statement: Statement
    error_phase: Annotated[Floats, _error("impact/phase", "1", "phase", "impact")]
    error_time: Annotated[Floats, _error("impact/time", "time", "time in the period", "impact")]
    error_momentum: Annotated[
        Floats, _error("impact/momentum", "mass length time-1", "momentum", "impact")
    ]
    error_velocity: Annotated[
        Floats, _error("impact/velocity", "length time-1", "velocity", "impact")
    ]
    error_contact_phase: Annotated[
        Floats | None,
        _error("contact/phase", "1", "phase", "contact", **_NO_NUMBER),
    ]
    error_contact_time: Annotated[
        Floats | None,
        _error("contact/time", "time", "time in the period", "contact", **_NO_NUMBER),
    ]
    error_contact_duration: Annotated[
        Floats | None,
        _error("contact/duration", "time", "duration", "contact", **_NO_NUMBER),
    ]
    error_contact_impulse: Annotated[
        Floats | None,
        _error("contact/impulse", "mass length time-1", "impulse", "contact", **_NO_NUMBER),
    ]
    error_contact_peak_force: Annotated[
        Floats | None,
        _error(
            "contact/peak_force", "mass length time-2", "largest force", "contact", **_NO_NUMBER
        ),
    ]
    error_contact_velocity: Annotated[
        Floats | None,
        _error("contact/velocity", "length time-1", "velocity", "contact", **_NO_NUMBER),
    ]
    error_contact_indentation: Annotated[
        Floats | None,
        _error("contact/indentation", "length", "indentation", "contact", **_NO_NUMBER),
    ]
    error_contact_start_indentation: Annotated[
        Floats | None,
        _error(
            "contact/start_indentation", "length", "distance beyond the wall at the beginning",
            "contact", **_NO_NUMBER,
        ),
    ]  # fmt: skip
    error_contact_energy_lost: Annotated[
        Floats | None,
        _error(
            "contact/energy_lost", "mass length2 time-2", "energy lost", "contact", **_NO_NUMBER
        ),
    ]
    error_stability: Annotated[
        Floats | None, _error("solution/stability", "1", "largest modulus", _ALL, **_NO_NUMBER)
    ]
    error_x_max: Annotated[
        Floats | None,
        _error("solution/x_max", "length", "largest displacement", _ALL, "dof", **_NO_NUMBER),
    ]
    error_x_min: Annotated[
        Floats | None,
        _error("solution/x_min", "length", "smallest displacement", _ALL, "dof", **_NO_NUMBER),
    ]
    error_rms: Annotated[
        Floats | None,
        _error("solution/rms", "length", "root mean square", _ALL, "dof", **_NO_NUMBER),
    ]
    error_energy_lost: Annotated[
        Floats | None,
        _error("solution/energy_lost", "mass length2 time-2", "energy lost", _ALL, **_NO_NUMBER),
    ]
    error_energy: Annotated[
        Floats | None,
        _error("solution/energy", "mass length2 time-2", "energy", _ALL, **_NO_NUMBER),
    ]
    error_work: Annotated[
        Floats | None, _error("solution/work", "mass length2 time-2", "work", _ALL, **_NO_NUMBER)
    ]
    error_multipliers_real: Annotated[
        Floats | None,
        _error(
            "multipliers/real",
            "1",
            "multiplier, and so of its real part",
            _ALL,
            "multiplier",
            **_NO_NUMBER,
        ),
    ]
    error_multipliers_imaginary: Annotated[
        Floats | None,
        _error(
            "multipliers/imaginary",
            "1",
            "same, of its imaginary part",
            _ALL,
            "multiplier",
            **_NO_NUMBER,
        ),
    ]
    error_waveform: Annotated[
        Floats | None,
        _error("waveform", "length", "displacement at all times", _ALL, ONE, "dof", **_NO_NUMBER),
    ]
