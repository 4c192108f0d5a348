"""Contact phases of stops whose force grows with a power, and their errors.

A coordinate that is known to dy reaches its wall early or late by

    dt = 2 dy / (v + (v^2 - 2 a dy)^(1/2)) ,

v and a being its rate and second rate there; where the root is imaginary, or the indentation is
less than dy, the contact may not take place, and its times are not known. The force at the largest
indentation d is off by no more than ``k (d + dy)^n - k d^n``, its impulse by that times the
duration.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.output_errors import passage
from vibroimpact_solvers.kernels.rigid_state import Rows
from vibroimpact_solvers.time_history.contact_errors import masked
from vibroimpact_solvers.time_history.soft import SoftRun
from vibroimpact_solvers.time_history.soft_errors import rows_of
from vibroimpact_solvers.time_history.soft_laws import PowerStops
from vibroimpact_solvers.time_history.stated_errors import LEAST
from vibroimpact_solvers.time_history.structure import Structure

_EPS: Final = 2.0**-52
_ROUNDED: Final = 8.0  # roundings of a number of a contact


def table(structure: Structure, laws: PowerStops, run: SoftRun, t_end: float) -> dict[str, Any]:
    """Return the table of contacts of a motion, with errors where they were estimated.

    Parameters
    ----------
    structure : Structure
    laws : PowerStops
    run : SoftRun
    t_end : float
    """
    assert run.phases is not None
    phases, scale = run.phases, structure.scale
    wall, deep = phases["wall"], phases["deepest"]
    going = np.isnan(phases["stop"])
    stop = np.where(going, t_end, np.minimum(phases["stop"] / scale, t_end))
    start = phases["start"] / scale
    side, k, n = laws.side[wall], laws.stiffness[wall], laws.exponent[wall]
    values: dict[str, Any] = {
        "start": start,
        "rest": start.copy(),
        "stop": stop,
        "constraint": laws.constraint[wall],
        "side": side,
        "velocity": scale * side * phases["velocity"],
        # The unit of forces goes with the square of that of time.
        "impulse": scale * phases["impulse"],
        "peak_force": k * deep**n,
        "indentation": deep.copy(),
        "energy_lost": np.zeros(phases.size),
    }
    values = {f"contact_{name}": value for name, value in values.items()}
    if run.distance is None:
        return values
    off, fast = (each[wall] for each in _of_walls(structure, laws, run))
    errors = _errors(phases, scale, stop, (off, fast), (k, n))
    errors["stop"] = np.where(going, LEAST, errors["stop"])
    for name, error in errors.items():
        at = start if name in {"start", "rest", "velocity"} else stop
        until = run.known_until if run.known_until < t_end else np.inf
        values[f"error_contact_{name}"] = masked(at, np.maximum(error, LEAST), until)
    return values


def _of_walls(structure: Structure, laws: PowerStops, run: SoftRun) -> tuple[Floats, Floats]:
    """Return the errors of the coordinates at walls and of their rates, each shape (wall,)."""
    assert run.distance is not None
    place, rate = rows_of(structure, run.distance, structure.W @ structure.shapes)
    size = np.abs(laws.indentations(np.zeros(len(structure.W))))
    a = laws.constraint
    return place[a] + _ROUNDED * _EPS * size, rate[a]


def _errors(
    phases: Rows,
    scale: float,
    stop: Floats,
    known: tuple[Floats, Floats],
    powers: tuple[Floats, Floats],
) -> dict[str, Floats]:
    """Return the errors of the columns of contacts, each shape (contact,).

    Known is to what the coordinates and their rates are, powers are stiffnesses and exponents.
    """
    (off, fast), (k, n), deep = known, powers, phases["deepest"]
    bends = scale**2 * np.abs(phases["bend"]), scale**2 * np.abs(phases["bend_at_stop"])
    speeds = scale * np.abs(phases["velocity"]), scale * np.abs(phases["leaving"])
    sure = (deep > off) | (phases["start"] == 0.0)
    early, late = (
        np.array(
            [
                passage(float(o), float(v), float(a)) if is_sure else np.inf
                for o, v, a, is_sure in zip(off, speed, bend, sure, strict=True)
            ]
        )
        for speed, bend in zip(speeds, bends, strict=True)
    )
    early = np.where(phases["start"] == 0.0, 0.0, early)
    start = phases["start"] / scale
    lasts = stop - start
    with np.errstate(over="ignore", invalid="ignore"):
        force = k * ((deep + off) ** n - deep**n) + _ROUNDED * n * _EPS * k * deep**n
        impulse = force * lasts + _ROUNDED * n * _EPS * np.abs(scale * phases["impulse"])
        impulse += scale * phases["unsure"]
        turned = np.where(early < np.inf, np.nan_to_num(early, posinf=0.0) * bends[0], 0.0)
        # Where the time is not known the speed is that of a touch.
        touched = np.sqrt(speeds[0] ** 2 + 2.0 * bends[0] * off)
    return {
        "start": early + _EPS * start,
        "rest": early + _EPS * start,
        "stop": late + _EPS * stop,
        "velocity": fast + np.where(early < np.inf, turned, touched),
        "impulse": impulse,
        "peak_force": force,
        "indentation": off + _ROUNDED * _EPS * deep,
        "energy_lost": np.zeros(phases.size),
    }
