"""Absolute errors of the outputs of slow flows, from their differences from the exact motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.slow_flow.motion import Model, Motion

ROUNDING: Final = 1e-12
"""Rounding of the exact motion, relative to the largest value."""


def durations(t_max: Floats, exact: Floats) -> dict[str, Floats]:
    """Return the errors of the times at which impacts end, 0 where they never do."""
    rounding = ROUNDING * float(exact) if np.isfinite(exact) else 0.0
    with np.errstate(invalid="ignore"):
        apart = 0.0 if t_max == exact else abs(float(t_max) - float(exact))
    return {"error_t_max": np.array(apart + rounding), "error_t_max_exact": np.array(rounding)}


def stated(
    model: Model, fields: Mapping[str, Any], motion: Motion, exact: Motion
) -> dict[str, Floats]:
    """Return the errors of the outputs that there are.

    Parameters
    ----------
    model : Model
    fields : mapping
        Those of the result, with the differences from the exact motion.
    motion, exact : Motion
        At the output times.
    """
    errors = dict[str, Floats]()
    for name in ("x", "v", "A", "B"):
        value, true = getattr(motion, name), getattr(exact, name)
        if value is not None and true is not None:
            # Where one of them strikes no more there is nothing to compare.
            errors[name] = np.abs(value - true) + _rounding(true)
    differences = {name: fields[f"difference_{name}"] for name in ("gamma", "phi")}
    for name, difference in differences.items():
        value = getattr(motion, name)
        if value is not None and difference is not None:
            near = _near(fields["t"], fields["impact_time"], difference)
            errors[name] = np.where(np.isnan(value), np.nan, near + _rounding(value))
        elif value is not None:
            errors[name] = np.full(value.shape, np.nan)
    errors |= _of_frequency(model, motion, exact, errors.get("gamma"))
    if fields["impact_time"] is not None:
        errors["impact_time"] = np.full(fields["impact_time"].shape, _rounding(fields["t"]))
        velocity = fields["impact_velocity"]
        errors["impact_velocity"] = np.full(velocity.shape, _rounding(velocity))
    return {f"error_{n}": e for n, e in errors.items() if fields.get(n) is not None}


def _of_frequency(
    model: Model, motion: Motion, exact: Motion, gamma_error: Floats | None
) -> dict[str, Floats]:
    """Return the errors of omega, impulse and momentum, which follow from gamma."""
    if motion.omega is None:
        return {}
    values = _following(model, motion)
    if motion.gamma is None or gamma_error is None or not motion.gamma.any():
        if exact.omega is None:
            return {name: np.full(value.shape, np.nan) for name, value in values.items()}
        true = _following(model, exact)
        return {name: np.abs(values[name] - true[name]) + _rounding(true[name]) for name in values}
    errors = {name: np.full(value.shape, _rounding(value)) for name, value in values.items()}
    for sign in (-1.0, 1.0):
        gamma = motion.gamma + sign * gamma_error
        # The product of both is the natural frequency.
        moved = replace(motion, gamma=gamma, omega=motion.omega * motion.gamma / gamma)
        for name, value in _following(model, moved).items():
            # nan: gamma may be any number.
            off = np.where(gamma > 0.0, np.abs(value - values[name]), np.inf)
            errors[name] = np.maximum(errors[name], off + _rounding(values[name]))
    return errors


def _following(model: Model, motion: Motion) -> dict[str, Floats]:
    assert motion.omega is not None
    values, p = {"omega": motion.omega}, model.impulse(motion)
    return values if p is None else values | {"impulse": p, "momentum": 2.0 * p / motion.omega}


def _near(t: Floats, impacts: Floats, differences: Floats) -> Floats:
    """Return the larger of the differences at the impacts before and after each time."""
    size = np.abs(differences)
    size = np.where(np.isnan(size), 0.0, size)  # after the last impact of the variant
    after = np.searchsorted(impacts, t)
    before, after = np.maximum(after - 1, 0), np.minimum(after, impacts.size - 1)
    return np.asarray(np.maximum(size[before], size[after]))


def _rounding(values: Floats) -> float:
    """Return the rounding of the exact motion in some values."""
    some = np.abs(values[np.isfinite(values)])
    return ROUNDING * float(some.max(initial=0.0))
