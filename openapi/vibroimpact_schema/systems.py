"""Documents that describe a structure with amplitude limiters: matrices, constraints, presets."""

from __future__ import annotations

from typing import Annotated, Final, Literal, Self

from pydantic import Discriminator, Field, Tag, model_validator
from pydantic_core import PydanticCustomError

from vibroimpact_schema.grids import FrequencyUnit, frequency_unit
from vibroimpact_schema.laws import Law
from vibroimpact_schema.values import (
    Count,
    Document,
    Index,
    Indices,
    NonNegative,
    Number,
    Numbers,
    Positive,
    form,
)


class DiagonalMatrix(Document):
    """A diagonal matrix."""

    diagonal: Numbers = Field(description="The n diagonal entries.", min_length=1)


class BandedMatrix(Document):
    """A symmetric banded matrix by its diagonals."""

    bands: dict[Annotated[str, Field(pattern="^(0|[1-9][0-9]{0,8})$")], Numbers] = Field(
        description="Offset from the main diagonal -> that diagonal, of n - offset entries; "
        "each stands for the lower one too. Absent offsets are zero.",
        min_length=1,
        examples=[{"0": [2.0, 2.0, 2.0], "1": [-1.0, -1.0]}],
    )


class CoordinateMatrix(Document):
    """A sparse matrix by the coordinates of its entries; symmetric entries are both given."""

    shape: Annotated[list[Count], Field(min_length=2, max_length=2)] = Field(
        description="[n, n].", examples=[[13, 13]]
    )
    row: Indices = Field(description="Row of each entry, from 0.")
    col: Indices = Field(description="Column of each entry, from 0.")
    data: Numbers = Field(description="Value of each entry.")


class ScalarMatrix(Document):
    """A number times the identity."""

    scalar: Number = Field(description="The number.")
    n: Count = Field(description="Size of the identity.")


_MATRICES: Final = {
    "diagonal": "@diagonal",
    "bands": "@bands",
    "data": "@coordinates",
    "shape": "@coordinates",
    "scalar": "@scalar",
}
"""Key of a matrix -> the tag of its form."""

DenseMatrix = Annotated[
    list[Numbers],
    Field(min_length=1, fail_fast=True, description="All rows.", title="DenseMatrix"),
]

Matrix = Annotated[
    Annotated[DenseMatrix, Tag("@dense")]
    | Annotated[DiagonalMatrix, Tag("@diagonal")]
    | Annotated[BandedMatrix, Tag("@bands")]
    | Annotated[CoordinateMatrix, Tag("@coordinates")]
    | Annotated[ScalarMatrix, Tag("@scalar")],
    Discriminator(
        lambda value: "@dense" if isinstance(value, list) else form(value, _MATRICES),
        custom_error_type="matrix_form",
        custom_error_message="a matrix is a list of rows, or an object with diagonal, bands, "
        "shape/row/col/data, or scalar and n",
    ),
]


class Direction(Document):
    """A direction in configuration space: the constrained coordinate is Σ weight · x[dof]."""

    dofs: Indices = Field(description="Degrees of freedom, each once.", min_length=1)
    weights: Numbers = Field(description="Weight of each of them.", min_length=1)


class Limits(Document):
    """Two limits of one coordinate, -lower ≤ y ≤ upper; lower + upper > 0."""

    lower: Number | None = Field(None, description="Distance to the lower wall; null: no wall.")
    upper: Number | None = Field(None, description="Distance to the upper wall; null: no wall.")


Gap = Annotated[
    Annotated[Positive, Tag("@distance")] | Annotated[Limits, Tag("@limits")],
    Discriminator(
        lambda gap: "@distance" if isinstance(gap, (int, float)) else form(gap, {}, "@limits"),
        custom_error_type="gap_form",
        custom_error_message='a gap is a positive number or {"lower": l, "upper": u}',
    ),
]


class WallSwing(Document):
    """A displacement ``amplitude cos(frequency t + phase)`` of both walls of a stop.

    In periodic motions it has a harmonic of the drive instead of a frequency.
    """

    amplitude: Number = Field(description="Its amplitude, length.")
    frequency: Positive | None = Field(None, description="Its angular frequency.")
    harmonic: Annotated[int, Field(strict=True, ge=1, le=1000)] | None = Field(
        None, description="Instead of it: its frequency as a multiple of the drive's."
    )
    phase: Number = Field(0.0, description="Its phase at t = 0.")


class WallSamples(Document):
    """Displacements of both walls of a stop at times, with straight lines between."""

    t: Annotated[list[Number], Field(min_length=2, fail_fast=True)] = Field(
        description="Ascending times, from 0 or before to t_end or after."
    )
    y: Annotated[list[Number], Field(min_length=2, fail_fast=True)] = Field(
        description="Displacements at these times."
    )


Wall = Annotated[
    Annotated[list[WallSwing], Field(max_length=100), Tag("@swings")]
    | Annotated[WallSamples, Tag("@samples")],
    Discriminator(
        lambda value: "@swings" if isinstance(value, list) else "@samples",
        custom_error_type="wall_form",
        custom_error_message="a wall is a list of harmonic terms, or an object with t and y",
    ),
]


class Constraint(Document):
    """A stop: a coordinate, its gap, and what happens beyond it."""

    dof: Index | None = Field(None, description="The constrained degree of freedom, from 0.")
    direction: Direction | None = Field(
        None, description="Instead of dof: a combination, such as a relative displacement."
    )
    gap: Gap = Field(description="Distance to the walls from the coordinate's zero (length).")
    restitution: Annotated[Number, Field(ge=0, le=1)] = Field(
        1.0, description="Newton's coefficient of restitution of a rigid stop; 1 is elastic."
    )
    law: Law | None = Field(
        None,
        description="What the stop does beyond its wall; absent: it is rigid. A stop with a law "
        "has no restitution beside it.",
    )
    wall: Wall | None = Field(
        None,
        description="How both walls move, which is added to their places: harmonic terms, or "
        "samples. Of linear stops in time histories and, harmonics of the drive, in periodic "
        "motions; absent: they are at rest.",
    )

    @model_validator(mode="after")
    def _one_coordinate(self) -> Self:
        if (self.dof is None) == (self.direction is None):
            raise PydanticCustomError(
                "dof_or_direction", "a constraint names either a dof or a direction"
            )
        if self.law is not None and self.restitution != 1.0:
            raise PydanticCustomError(
                "two_restitutions",
                "the restitution of a stop with a law stands in the law, not beside it",
            )
        return self


Constraints = Annotated[list[Constraint], Field(fail_fast=True)]


_UNIT_OF_MASS: Final = r"^[A-Za-zµ°]{1,16}[1-4]?([ /][A-Za-zµ°]{1,16}[1-4]?){0,3}$"
"""Symbols with powers: a space multiplies, a stroke divides by the next one."""


class Units(Document):
    """The consistent set of units of the numbers."""

    length: Annotated[str, Field(pattern="^[A-Za-zµ°]{1,16}$")] = Field(examples=["m"])
    mass: Annotated[str, Field(pattern=_UNIT_OF_MASS)] = Field(
        examples=["kg"], description='Also composed ones, such as "lbf s2/in".'
    )
    time: Annotated[str, Field(pattern="^[A-Za-zµ°]{1,16}$")] = Field(examples=["s"])


Ratios = Annotated[
    Annotated[NonNegative, Tag("@one")]
    | Annotated[list[NonNegative], Field(min_length=1, fail_fast=True), Tag("@each")],
    Discriminator(lambda value: "@each" if isinstance(value, list) else "@one"),
]


class RatioDamping(Document):
    """Damping by parts of the critical damping of the natural modes."""

    ratio: Ratios = Field(
        description="Damping ratio zeta of all modes, or a list of one for each, from the lowest; "
        "of at most 512 degrees of freedom with mass: C is full. Rigid-body modes have none.",
        examples=[0.02],
    )


class RayleighRatios(Document):
    """Damping ratios at two frequencies."""

    ratios: Annotated[list[NonNegative], Field(min_length=2, max_length=2)] = Field(
        description="Damping ratios zeta.", examples=[[0.02, 0.03]]
    )
    at: Annotated[list[Positive], Field(min_length=2, max_length=2)] = Field(
        description="The frequencies, which differ.", examples=[[10.0, 50.0]]
    )
    unit: FrequencyUnit = frequency_unit("Meaning of the frequencies, as in grids of them.")


RayleighCoefficients = Annotated[
    list[NonNegative],
    Field(
        min_length=2,
        max_length=2,
        fail_fast=True,
        description="[alpha, beta] of C = alpha M + beta K (1/time, time).",
        title="RayleighCoefficients",
    ),
]


class RayleighDamping(Document):
    """Damping proportional to the masses and to the springs."""

    rayleigh: Annotated[
        Annotated[RayleighCoefficients, Tag("@coefficients")]
        | Annotated[RayleighRatios, Tag("@ratios")],
        Discriminator(
            lambda value: (
                "@coefficients" if isinstance(value, list) else form(value, {}, "@ratios")
            ),
            custom_error_type="rayleigh_form",
            custom_error_message="Rayleigh damping is [alpha, beta], or an object with ratios "
            "and at",
        ),
    ] = Field(description="Its two coefficients, or the ratios that they make.")


class StructuralDamping(Document):
    """Viscous damping that is equivalent to a loss factor at one frequency: C = (eta/Omega) K."""

    structural: NonNegative = Field(description="Loss factor eta.", examples=[0.01])
    at: Positive = Field(description="The frequency at which they lose the same.")
    unit: FrequencyUnit = frequency_unit("Meaning of the frequency, as in grids of them.")


Damping = Annotated[
    Annotated[RatioDamping, Tag("@ratio")]
    | Annotated[RayleighDamping, Tag("@rayleigh")]
    | Annotated[StructuralDamping, Tag("@structural")],
    Discriminator(
        lambda value: form(
            value, {"ratio": "@ratio", "rayleigh": "@rayleigh", "structural": "@structural"}
        ),
        custom_error_type="damping_form",
        custom_error_message="damping is an object with ratio, with rayleigh, or with structural "
        "and at",
    ),
]


class Dashpot(Document):
    """A viscous damper of the coordinate Σ weight · x[dof]."""

    dofs: Indices = Field(
        description="Degrees of freedom, each once.", min_length=1, max_length=100
    )
    weights: Numbers = Field(description="Weight of each of them.", min_length=1, max_length=100)
    c: NonNegative = Field(description="Force by unit velocity (mass / time).")


Dashpots = Annotated[list[Dashpot], Field(max_length=1000, fail_fast=True)]


Flexibility = Annotated[list[Numbers], Field(fail_fast=True)]


class Structure(Document):
    """Fields of all structures."""

    damping: Damping | None = Field(
        None, description="Damping by ratios, Rayleigh's or structural; absent: none, or C."
    )
    dashpots: Dashpots | None = Field(None, description="Dampers besides, which add to C.")

    influence: Numbers | None = Field(
        None,
        description="Displacements of the structure by a unit displacement of its base, such as 1 "
        "for those in its direction, shape [n]; for loads by the base and effective masses.",
    )
    residual_flexibility: Flexibility | None = Field(
        None,
        description="Rows of the static flexibility between the constraints of what a model of few "
        "modes leaves out, symmetric and positive semidefinite, shape [constraint, constraint]. It "
        "is in series with linear stops without damping; absent: none.",
    )

    def check_one_damping(self, other: str) -> Self:
        """Refuse damping beside another field that gives it."""
        if self.damping is not None:
            raise PydanticCustomError(
                "two_dampings",
                "give {other} or damping, not both; dashpots add to either",
                {"other": other},
            )
        return self


class MatrixSystem(Structure):
    """M x″ + C x′ + K x = force, with constraints."""

    M: Matrix = Field(
        description=(
            "Mass matrix, symmetric, shape [n, n]. Positive definite, apart from rows and columns "
            "of zeros: such degrees of freedom have no mass and follow the others statically. "
            "They need positive definite stiffness, and take no constraint, load or damping."
        )
    )
    K: Matrix = Field(description="Stiffness matrix, symmetric, shape [n, n].")
    C: Matrix | None = Field(None, description="Damping matrix, symmetric, shape [n, n].")
    force: Numbers | None = Field(None, description="Constant load, shape [n].")
    constraints: Constraints = Field(
        [], description="Limiters; results refer to them by position. Absent: none."
    )
    units: Units | None = Field(None, description="Absent: dimensionless.")

    @model_validator(mode="after")
    def _one_damping(self) -> Self:
        return self if self.C is None else self.check_one_damping("C")


class SystemReference(Document):
    """A system stored by POST /v1/systems."""

    id: Annotated[str, Field(pattern="^sys_[0-9a-f]{64}$")] = Field(
        description="Its name, as POST /v1/systems returned it."
    )
    constraints: Constraints | None = Field(
        None, description="Replace the stored constraints; absent: keep them."
    )
    damping: Damping | None = Field(
        None, description="Replaces the stored damping, of a system without C; absent: keep it."
    )
    residual_flexibility: Flexibility | None = Field(
        None,
        description="Replaces the stored one, as constraints do where it is absent, which have "
        "none then; absent without constraints: keep it.",
    )


class Preset(Structure):
    """Fields of all presets."""

    constraints: Constraints = Field(
        [], description="Limiters; results refer to them by position. Absent: none."
    )
    units: Units | None = Field(None, description="Absent: dimensionless.")


class Chain(Preset):
    """Equal masses joined by equal springs between fixed ends (eq. 10.60)."""

    preset: Literal["chain"]
    n: Count = Field(description="Number of masses.")
    mass: Positive = Field(1.0, description="Each mass.")
    stiffness: Positive = Field(1.0, description="Each spring.")


class Oscillator(Preset):
    """One mass on a spring: M = 1, K = Omega0², C = 2 zeta Omega0."""

    preset: Literal["oscillator"]
    Omega0: Positive = Field(description="Natural angular frequency.")
    zeta: NonNegative = Field(0.0, description="Damping ratio.")

    @model_validator(mode="after")
    def _one_damping(self) -> Self:
        return self.check_one_damping("zeta") if self.zeta else self


class TwoMass(Preset):
    """Two coupled oscillators: K = Omega0² [[1 + c, -c], [-c, 1 + c]] (eq. 10.22, 10.42)."""

    preset: Literal["two_mass"]
    Omega0: Positive = Field(description="Natural angular frequency of each alone.")
    coupling: Number = Field(1.0, description="c above.")
    zeta: NonNegative = Field(0.0, description="Damping ratio of the first mass.")

    @model_validator(mode="after")
    def _one_damping(self) -> Self:
        return self.check_one_damping("zeta") if self.zeta else self


class DoublePendulum(Preset):
    """Linearised double pendulum: M = [[mu², 1], [1, 1]], K = diag(mu², 1) (eq. 10.30)."""

    preset: Literal["double_pendulum"]
    mu: Annotated[Number, Field(gt=1)] = Field(description="Square root of the total mass ratio.")


class BouncingBall(Preset):
    """A ball over a floor: M = 1, K = 0, force -g."""

    preset: Literal["bouncing_ball"]
    g: Positive = Field(9.81, description="Acceleration of gravity.")


class Absorber(Preset):
    """A mass on a spring that carries a small one, coordinate 1.

    M = diag(1, r), K = Omega0² [[1 + r t², -r t²], [-r t², r t²]]. A stop between the two has a
    direction: dofs [1, 0], weights [1, -1].
    """

    preset: Literal["absorber"]
    Omega0: Positive = Field(description="Natural angular frequency of the large mass alone.")
    ratio: Positive = Field(0.05, description="Small mass over the large one, r.")
    tuning: NonNegative = Field(
        1.0,
        description="Frequency of the small mass alone over Omega0, t; 0: it has no spring, and "
        "only its stops hold it.",
    )


class Beam(Preset):
    """A cantilever of equal Euler-Bernoulli elements.

    Degrees of freedom: deflection and rotation of each node in turn, from the clamp on.
    """

    preset: Literal["beam"]
    elements: Count = Field(description="Number of elements; twice as many degrees of freedom.")
    length: Positive = Field(1.0, description="Of the whole beam.")
    EI: Positive = Field(1.0, description="Bending stiffness.")
    rhoA: Positive = Field(1.0, description="Mass per length.")


AnyPreset = Annotated[
    Chain | Oscillator | TwoMass | DoublePendulum | BouncingBall | Absorber | Beam,
    Field(discriminator="preset"),
]


System = Annotated[
    Annotated[MatrixSystem, Tag("@matrices")]
    | Annotated[AnyPreset, Tag("@preset")]
    | Annotated[SystemReference, Tag("@reference")],
    Discriminator(
        lambda value: form(value, {"id": "@reference", "preset": "@preset"}, "@matrices"),
        custom_error_type="system_form",
        custom_error_message="a system is an object with M and K, "
        "with preset, or with the id of a stored system",
    ),
]
AnySystem = (
    MatrixSystem | Chain | Oscillator | TwoMass | DoublePendulum | BouncingBall | Absorber | Beam
)
