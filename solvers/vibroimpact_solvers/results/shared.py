"""Fields that the results of several kinds have."""

from __future__ import annotations

from typing import Annotated, Final

from vibroimpact_solvers.arrays import Integers, Quantity

ONE: Final = "one"
"""The dimension, of length one, of an error that holds for all positions on an axis."""
TIME: Final = Quantity(("time",), "time", "time", True)
X: Final = Quantity(("time", "dof"), "length", "displacement")
V: Final = Quantity(("time", "dof"), "length time-1", "velocity")
EXISTS: Final = ("phantom", "real")
"""In files, whether a solution is admissible."""
WITHIN: Final = ("beyond", "within")
"""In files, whether an error is within the tolerance."""

Dofs = Annotated[Integers | None, Quantity(("dof",), "1", "index of the degree of freedom", True)]
Statement = Annotated[
    str, Quantity((), "1", "how the errors were obtained", path="error/statement")
]
NO_YES: Final = ("no", "yes")
"""In files, whether something holds."""
NEUTRAL: Final = (
    "whether that is 1 within its error: neither stable nor unstable, as far as is known"
)
Neglected = Annotated[
    list[str] | None,
    Quantity((), "1", "what of the structure has no effect, and why", path="neglected"),
]
"""Absent where all of it has."""
