"""Units of derived quantities in the sets of units that engineers use."""

from __future__ import annotations

import pydantic
import pytest

from vibroimpact_schema.systems import Units
from vibroimpact_service.results.units import unit

DERIVED = {
    "mass length time-2": "force", "mass length2 time-2": "energy",
    "mass length time-1": "momentum", "mass time-2": "stiffness", "mass time-1": "damping",
}  # fmt: skip


@pytest.mark.parametrize(
    ("length", "mass", "expected"),
    [("m", "kg", ["N", "J", "kg m/s", "N/m", "kg/s"]),
     ("mm", "t", ["N", "mJ", "t mm/s", "kN/m", "t/s"]),
     ("m", "Mg", ["kN", "kJ", "Mg m/s", "kN/m", "Mg/s"]),
     ("in", "lbf s2/in", ["lbf", "lbf in", "lbf s", "lbf/in", "lbf s/in"]),
     ("ft", "slug", ["slug ft/s2", "slug ft2/s2", "slug ft/s", "slug/s2", "slug/s"])],
)  # fmt: skip
def test_units_of_derived_quantities(length: str, mass: str, expected: list[str]) -> None:
    units = Units(length=length, mass=mass, time="s").model_dump()
    assert [unit(each, units) for each in DERIVED] == expected
    assert unit("mass", units) == mass


@pytest.mark.parametrize("mass", ["", " kg", "kg ", "lbf s9/in", "a b c d e", "k/", "<b>", "kg\n"])
def test_what_is_no_unit_of_mass_is_refused(mass: str) -> None:
    with pytest.raises(pydantic.ValidationError):
        Units(length="m", mass=mass, time="s")
