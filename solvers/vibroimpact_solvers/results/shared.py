"""Fields that the results of several kinds have."""

from __future__ import annotations

from typing import Annotated, Final

from vibroimpact_solvers.arrays import Group, Integers, Quantity

ONE: Final = "one"
"""The dimension, of length one, of an error that holds for all positions on an axis."""
TIME: Final = Quantity(("time",), "time", "time", True)
X: Final = Quantity(("time", "dof"), "length", "displacement")
V: Final = Quantity(("time", "dof"), "length time-1", "velocity")
A: Final = Quantity(("time", "dof"), "length time-2", "acceleration")
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


# -- Derivatives --------------------------------------------------------------------------

Parameters = Annotated[
    list[str] | None,
    Quantity(
        ("parameter",),
        "1",
        "path of the parameter of the derivatives",
        True,
        path="derivative/parameter",
    ),
]
ParameterUnits = Annotated[
    list[str] | None,
    Quantity(
        ("parameter",),
        "1",
        "unit of the parameter, by which those of the derivatives are divided",
        path="derivative/unit",
    ),
]
DERIVATIVES: Final = {
    "derivative": Group(
        "Derivatives",
        "Derivatives of the outputs by the parameters, per unit of the parameter.",
        together=False,
    ),
    "error/derivative": Group(
        "DerivativeErrors", "Absolute errors of the derivatives.", together=False
    ),
}


def derivative(dims: tuple[str, ...], unit: str, of: str, output: str) -> Quantity:
    """Return the declaration of the derivatives of an output."""
    return Quantity(
        (*dims, "parameter"),
        unit,
        f"derivative of the {of} by the parameter",
        path=f"derivative/{output}",
        missing="there is none, see reason",
        error=f"error/derivative/{output}",
    )


def derivative_error(dims: tuple[str, ...], unit: str, of: str, output: str) -> Quantity:
    """Return the declaration of the absolute errors of the derivatives of an output."""
    return Quantity(
        (*dims, "parameter"),
        unit,
        f"error of the derivative of the {of}",
        path=f"error/derivative/{output}",
        missing="unbounded, or there is no derivative",
    )
