"""The table: which stage each field invalidates, and the quantities of the fields."""

from __future__ import annotations

import pytest

from vibroimpact_solvers import sweep
from vibroimpact_solvers.plan import Stage

_IMPACT_MODES = [
    ("system.constraints.0.gap", Stage.IMPULSE),
    ("system.constraints.1.gap.upper", Stage.IMPULSE),
    ("system.constraints.0.restitution", None),
    ("system.constraints.0.dof", Stage.RESPONSE),
    ("system.constraints.0.direction.weights.1", Stage.RESPONSE),
    ("system.force.3", Stage.RESPONSE),
    ("system.zeta", None),
    ("system.C.0.0", None),
    ("system.K.0.1", Stage.SPECTRUM),
    ("system.M.diagonal.2", Stage.SPECTRUM),
    ("system.stiffness", Stage.SPECTRUM),
    ("system.coupling", Stage.SPECTRUM),
    ("frequency.start", Stage.RESPONSE),
    ("frequency.values.0", Stage.RESPONSE),
    ("tau.0", Stage.WAVEFORM),
    ("a.field.of.which.nothing.is.known", Stage.SPECTRUM),
]


@pytest.mark.parametrize(("path", "stage"), _IMPACT_MODES)
def test_what_fields_of_impact_modes_invalidate(path: str, stage: Stage | None) -> None:
    rule = sweep.rule("impact-modes", path.split("."))
    assert rule.stage is stage
    assert rule.stage is not None or rule.why


def test_restitution_counts_where_stability_is_asked() -> None:
    rule = sweep.rule("impact-modes", ("system", "constraints", 0, "restitution"))
    assert rule.unless == {"stability": Stage.STABILITY}


@pytest.mark.parametrize(
    ("path", "meaning"),
    [
        ("system.constraints.0.gap", ("length", "gap")),
        ("system.K.0.1", ("mass time-2", "stiffness")),
        ("system.M.bands.1.4", ("mass", "mass")),
        ("system.Omega0", ("time-1", "natural angular frequency")),
        ("frequency.start", ("time-1", "frequency")),
        ("something.new", ("1", "something.new")),
    ],
)
def test_what_fields_mean(path: str, meaning: tuple[str, str]) -> None:
    assert sweep.meaning(path.split(".")) == meaning
