"""Laws of stops in documents: what is no law is refused, whatever it is."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from vibroimpact_schema.laws import HertzLaw, LinearLaw, PowerLaw
from vibroimpact_schema.systems import Constraint


@pytest.mark.parametrize("kind", [{}, [], 1, None, "soft", True])
def test_a_type_that_is_none_is_refused(kind: Any) -> None:
    """One without a hash, such as an object, ended in an internal error."""
    law = {"type": kind, "stiffness": 1.0}
    with pytest.raises(ValidationError, match='"rigid", "linear", "hertz" or "power"'):
        Constraint.model_validate({"dof": 0, "gap": 1.0, "law": law})


def test_a_law_is_read() -> None:
    document = {"dof": 0, "gap": 1.0, "law": {"type": "linear", "stiffness": 2.0}}
    law = Constraint.model_validate(document).law
    assert isinstance(law, LinearLaw)
    assert law.stiffness == 2.0


def test_laws_of_powers_are_read() -> None:
    hertz, power = (
        Constraint.model_validate({"dof": 0, "gap": 1.0, "law": law}).law
        for law in (
            {"type": "hertz", "stiffness": 2.0},
            {"type": "power", "stiffness": 3.0, "exponent": 2.5},
        )
    )
    assert isinstance(hertz, HertzLaw)
    assert isinstance(power, PowerLaw)
    assert (hertz.stiffness, power.stiffness, power.exponent) == (2.0, 3.0, 2.5)
