"""Laws of stops in documents: what is no law is refused, whatever it is."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from vibroimpact_schema.laws import LinearLaw
from vibroimpact_schema.systems import Constraint


@pytest.mark.parametrize("kind", [{}, [], 1, None, "soft", True])
def test_a_type_that_is_none_is_refused(kind: Any) -> None:
    """One without a hash, such as an object, ended in an internal error."""
    law = {"type": kind, "stiffness": 1.0}
    with pytest.raises(ValidationError, match='with the type "rigid" or "linear"'):
        Constraint.model_validate({"dof": 0, "gap": 1.0, "law": law})


def test_a_law_is_read() -> None:
    document = {"dof": 0, "gap": 1.0, "law": {"type": "linear", "stiffness": 2.0}}
    law = Constraint.model_validate(document).law
    assert isinstance(law, LinearLaw)
    assert law.stiffness == 2.0
