"""Columns of attractors about contacts with stops of finite stiffness."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from vibroimpact_solvers.arrays import EPS, along
from vibroimpact_solvers.attractors.contact_verification import ConfirmedContacts
from vibroimpact_solvers.attractors.problem import Problem
from vibroimpact_solvers.attractors.rates import rate
from vibroimpact_solvers.attractors.verdicts import Verdict
from vibroimpact_solvers.results.attractors import Result

_WHOLE = ("constraint", "side")


def of(
    problem: Problem, shown: Sequence[Verdict], proofs: Sequence[ConfirmedContacts]
) -> dict[str, Any]:
    """Return the columns of contacts, None where stops are rigid."""
    names = [name.removeprefix("contact_") for name in along(Result, "contact")
             if name.startswith("contact_")]  # fmt: skip
    errors = [name for name in names if f"error_contact_{name}" in along(Result, "contact")]
    columns: dict[str, Any] = dict.fromkeys((
        *(f"contact_{name}" for name in names), *(f"error_contact_{name}" for name in errors),
        "attractor_contacts", "attractor_contact_rate", "error_contact_rate",
    ))  # fmt: skip
    if not problem.stopped:
        return columns
    counts = [len(proof.rows) for proof in proofs]
    rates = np.array([
        rate(problem, one, one.motion.contacts["start"], count, proof.verification)
        for one, count, proof in zip(shown, counts, proofs, strict=True)
    ]).reshape(-1, 2)  # fmt: skip
    rows = [
        row | _time(problem, one, row)
        for one, proof in zip(shown, proofs, strict=True)
        for row in proof.rows
    ]
    columns |= {
        "attractor_contacts": np.array(counts, dtype=np.int64),
        "attractor_contact_rate": rates[:, 0],
        "error_contact_rate": rates[:, 1],
        "contact_attractor": np.repeat(np.arange(len(proofs)), counts),
    }
    for name in names[1:]:
        kind = np.int64 if name in _WHOLE else np.float64
        columns[f"contact_{name}"] = np.array([row[name] for row in rows], dtype=kind)
    for name in errors:
        values = [row[f"error_{name}"] for row in rows]
        columns[f"error_contact_{name}"] = np.array(values, dtype=np.float64)
    return columns


def _time(problem: Problem, one: Verdict, row: dict[str, Any]) -> dict[str, float]:
    """Return the time of a contact in a period of a motion, from its last state on."""
    if not one.period or math.isnan(row["velocity"]):  # it lasts throughout
        return {}
    T, turn = problem.period, 2.0 * math.pi
    end = problem.settle + one.motion.periods
    turns = round((row["time"] * float(problem.Omega[0]) - row["phase"]) / turn) - end
    time = (row["phase"] / turn + turns % one.period) * T
    return {"time": time, "error_time": row["error_time"] + 2.0 * EPS * time}
