"""The mechanical model: M x'' + C x' + K x = f with rigid limiters, checked when it is made."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import scipy.linalg
import scipy.sparse
from numpy.typing import ArrayLike

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import ModelError

# Entries that differ by less, relative to the largest, are taken as equal: assembled
# finite-element matrices are symmetric only up to the rounding of their sums.
_SYMMETRY = 1e-12


class Form(StrEnum):
    """How a matrix is held."""

    DIAGONAL = "diagonal"
    TRIDIAGONAL = "tridiagonal"
    BANDED = "banded"
    DENSE = "dense"


@dataclass(frozen=True, eq=False, slots=True)
class SymmetricMatrix:
    """A real symmetric matrix in the leanest form that holds it.

    Made by one of the class methods, which check it.

    Parameters
    ----------
    data : array
        The rows, shape (n, n), or the main diagonal and those below, shape (bands, n), row k
        holding the entries (i + k, i), as `scipy.linalg.eig_banded` takes them.
    form : Form
        Which of the two, and how many bands.
    """

    data: Floats
    form: Form

    @classmethod
    def dense(cls, rows: ArrayLike) -> SymmetricMatrix:
        """Take a full matrix, shape (n, n); a banded one is recognised."""
        try:
            full = np.array(rows, dtype=np.float64)
        except (TypeError, ValueError):
            raise ModelError((), "the rows have different lengths", code="not_square") from None
        if full.ndim != 2 or full.shape[0] != full.shape[1] or full.size == 0:
            size = " x ".join(str(side) for side in full.shape)
            raise ModelError((), f"the matrix is {size}, not square", code="not_square")
        _require_finite(full)
        gap = np.abs(full - full.T)
        if gap.max() > _SYMMETRY * np.abs(full).max():
            i, j = (int(k) for k in np.unravel_index(np.argmax(gap), gap.shape))
            message = f"entries ({i}, {j}) = {full[i, j]!r} and ({j}, {i}) = {full[j, i]!r} differ"
            raise ModelError((), message, code="not_symmetric")
        full = 0.5 * (full + full.T)
        width = _bandwidth(full)
        if 2 * width < full.shape[0] or width == 0:
            bands = np.zeros((width + 1, full.shape[0]))
            for k in range(width + 1):
                bands[k, : full.shape[0] - k] = np.diagonal(full, k)
            return cls(_frozen(bands), _banded_form(width))
        return cls(_frozen(full), Form.DENSE)

    @classmethod
    def diagonal(cls, entries: ArrayLike) -> SymmetricMatrix:
        """Take the diagonal, shape (n,)."""
        return cls.bands({0: np.asarray(entries, dtype=np.float64)})

    @classmethod
    def bands(cls, diagonals: Mapping[int, ArrayLike]) -> SymmetricMatrix:
        """Take diagonals by their offset from the main one, which must be among them."""
        if 0 not in diagonals:
            raise ModelError((), "the main diagonal, offset 0, is missing", code="missing_diagonal")
        given = {k: np.asarray(v, dtype=np.float64) for k, v in diagonals.items()}
        n = given[0].size
        for offset, entries in given.items():
            if not 0 <= offset < n or entries.shape != (n - offset,):
                message = f"diagonal {offset} has {entries.size} entries instead of {n - offset}"
                raise ModelError((str(offset),), message, code="not_square")
            _require_finite(entries)
        width = max((k for k, v in given.items() if v.any()), default=0)
        data = np.zeros((width + 1, n))
        for offset in range(width + 1):
            if offset in given:
                data[offset, : n - offset] = given[offset]
        return cls(_frozen(data), _banded_form(width))

    @classmethod
    def sparse(
        cls, shape: Sequence[int], row: ArrayLike, col: ArrayLike, data: ArrayLike
    ) -> SymmetricMatrix:
        """Take entries by their coordinates; those given twice are added."""
        if len(shape) != 2 or shape[0] != shape[1]:
            raise ModelError(("shape",), "the matrix is not square", code="not_square")
        n = int(shape[0])
        rows, columns = np.asarray(row, dtype=np.int64), np.asarray(col, dtype=np.int64)
        values = np.asarray(data, dtype=np.float64)
        if not rows.size == columns.size == values.size:
            raise ModelError((), "row, col and data have different lengths", code="wrong_length")
        for name, index in (("row", rows), ("col", columns)):
            if index.size and (index.min() < 0 or index.max() >= n):
                raise ModelError((name,), f"an index is not below {n}", code="index_out_of_range")
        _require_finite(values)
        matrix = scipy.sparse.coo_array((values, (rows, columns)), shape=(n, n)).tocsr()
        if abs(matrix - matrix.T).max() > _SYMMETRY * max(abs(matrix).max(), 1e-300):
            raise ModelError((), "the entries are not symmetric", code="not_symmetric")
        lower = scipy.sparse.tril(matrix).tocoo()
        offsets = lower.row - lower.col
        width = int(offsets.max(initial=0))
        if 2 * width >= n and width:
            return cls.dense(matrix.toarray())
        bands = np.zeros((width + 1, n))
        bands[offsets, lower.col] = lower.data
        return cls(_frozen(bands), _banded_form(width))

    @property
    def n(self) -> int:
        """Number of rows."""
        return int(self.data.shape[1])

    def to_dense(self) -> Floats:
        """Return the full matrix, shape (n, n)."""
        if self.form is Form.DENSE:
            return self.data
        full = np.zeros((self.n, self.n))
        for k, band in enumerate(self.data):
            index = np.arange(self.n - k)
            full[index, index + k] = full[index + k, index] = band[: self.n - k]
        return full

    def digest(self) -> bytes:
        """Return a hash of the content."""
        text = hashlib.blake2b(f"{self.form} {self.data.shape}".encode())
        text.update(np.ascontiguousarray(self.data).tobytes())
        return text.digest()


def _frozen(array: Floats) -> Floats:
    array.setflags(write=False)
    return array


def _require_finite(array: Floats) -> None:
    if not np.isfinite(array).all():
        raise ModelError((), "an entry is nan or infinite", code="not_finite")


def _bandwidth(full: Floats) -> int:
    rows, columns = np.nonzero(full)
    return int(np.abs(rows - columns).max(initial=0))


def _banded_form(width: int) -> Form:
    return (Form.DIAGONAL, Form.TRIDIAGONAL)[width] if width < 2 else Form.BANDED


@dataclass(frozen=True, slots=True)
class Constraint:
    """A rigid limiter of the coordinate ``y = sum(weight * x[dof])``, ``-lower <= y <= upper``.

    Parameters
    ----------
    dofs : tuple of int
        Degrees of freedom that make up the coordinate, counted from 0.
    weights : tuple of float
        Their weights.
    lower, upper : float or None
        Distances to the walls (length); None where there is no wall.
    restitution : float
        Newton's coefficient, 0 to 1.
    """

    dofs: tuple[int, ...]
    weights: tuple[float, ...]
    lower: float | None
    upper: float | None
    restitution: float = 1.0

    def __post_init__(self) -> None:
        if not self.dofs or len(set(self.dofs)) != len(self.dofs):
            message = "the dofs of a direction must be there and differ"
            raise ModelError(("direction", "dofs"), message, code="duplicate_dof")
        if len(self.weights) != len(self.dofs) or not all(map(math.isfinite, self.weights)):
            message = "a direction needs one finite weight per dof"
            raise ModelError(("direction", "weights"), message, code="wrong_length")
        if not any(self.weights):
            message = "all weights of the direction are zero"
            raise ModelError(("direction", "weights"), message, code="zero_direction")
        walls = [wall for wall in (self.lower, self.upper) if wall is not None]
        if not walls or not all(map(math.isfinite, walls)):
            message = "a constraint needs at least one wall, at a finite distance"
            raise ModelError(("gap",), message, code="no_wall")
        if len(walls) == 2 and sum(walls) <= 0:
            message = f"the walls leave no room: lower + upper is {sum(walls)!r}, not positive"
            raise ModelError(("gap",), message, code="gap_not_positive")
        if not 0.0 <= self.restitution <= 1.0:
            message = f"the coefficient of restitution is {self.restitution!r}, not in [0, 1]"
            raise ModelError(("restitution",), message, code="restitution_out_of_range")

    @classmethod
    def at(cls, dof: int, gap: float, restitution: float = 1.0) -> Constraint:
        """Limit one degree of freedom to ``|x[dof]| <= gap``."""
        return cls((dof,), (1.0,), gap, gap, restitution)

    @property
    def symmetric(self) -> bool:
        """Whether both walls are there and equally far."""
        return self.lower is not None and self.lower == self.upper

    @property
    def coordinate(self) -> tuple[tuple[int, float], ...]:
        """Its nonzero weights in order, the same for equal coordinates."""
        pairs = sorted((d, w) for d, w in zip(self.dofs, self.weights, strict=True) if w)
        return tuple(pairs)


@dataclass(frozen=True, slots=True)
class Units:
    """The consistent set of units that the numbers are meant in."""

    length: str
    mass: str
    time: str


@dataclass(frozen=True, slots=True)
class ChainShape:
    """What makes a system a uniform chain with known modes (eq. 10.60, 10.63)."""

    n: int
    mass: float
    stiffness: float


@dataclass(frozen=True, eq=False)
class System:
    """A structure with limiters.

    Parameters
    ----------
    M, K : SymmetricMatrix
        Mass (positive definite) and stiffness, shape (n, n).
    constraints : sequence of Constraint
        The limiters; results refer to them by position.
    C : SymmetricMatrix, optional
        Damping.
    force : array, shape (n,), optional
        Constant load.
    units : Units, optional
        Units of the numbers; None for dimensionless ones.
    chain : ChainShape, optional
        Set by `presets.chain`: its natural modes are known in closed form.

    Raises
    ------
    ModelError
        Naming the field that is wrong.
    """

    M: SymmetricMatrix
    K: SymmetricMatrix
    constraints: tuple[Constraint, ...]
    C: SymmetricMatrix | None = None
    force: Floats | None = None
    units: Units | None = None
    chain: ChainShape | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "constraints", tuple(self.constraints))
        for name, matrix in (("K", self.K), ("C", self.C)):
            if matrix is not None and matrix.n != self.n:
                message = f"{name} has {matrix.n} rows, M has {self.n}"
                raise ModelError((name,), message, code="wrong_size")
        if self.force is not None:
            force = _frozen(np.array(self.force, dtype=np.float64))
            if force.shape != (self.n,) or not np.isfinite(force).all():
                message = f"the force needs {self.n} finite numbers"
                raise ModelError(("force",), message, code="wrong_size")
            object.__setattr__(self, "force", force)
        self._check_constraints()
        if self.chain is None:
            _require_positive_definite(self.M)

    def _check_constraints(self) -> None:
        seen: dict[tuple[tuple[int, float], ...], int] = {}
        for index, constraint in enumerate(self.constraints):
            for dof in constraint.dofs:
                if not 0 <= dof < self.n:
                    field = ("dof",) if len(constraint.dofs) == 1 else ("direction", "dofs")
                    message = f"dof {dof} is not below the number of degrees of freedom, {self.n}"
                    pointer = ("constraints", index, *field)
                    raise ModelError(pointer, message, code="index_out_of_range")
            first = seen.setdefault(constraint.coordinate, index)
            if first != index:
                message = f"it limits the same coordinate as constraint {first}"
                pointer = ("constraints", index)
                raise ModelError(pointer, message, code="duplicate_constraint")

    @property
    def n(self) -> int:
        """Number of degrees of freedom."""
        return self.M.n

    def directions(self, active: Sequence[int]) -> Floats:
        """Return the rows w_a of the named constraints, shape (constraint, dof)."""
        rows = np.zeros((len(active), self.n))
        for row, index in zip(rows, active, strict=True):
            constraint = self.constraints[index]
            row[list(constraint.dofs)] = constraint.weights
        return rows


def _require_positive_definite(M: SymmetricMatrix) -> None:
    try:
        if M.form is Form.DENSE:
            scipy.linalg.cholesky(M.data, lower=True, check_finite=False)
        elif M.form is Form.DIAGONAL:
            if not (M.data[0] > 0.0).all():
                raise scipy.linalg.LinAlgError  # noqa: TRY301 (one handler for three forms)
        else:
            scipy.linalg.cholesky_banded(M.data, lower=True, check_finite=False)
    except scipy.linalg.LinAlgError:
        message = "the mass matrix is not positive definite"
        raise ModelError(("M",), message, code="not_positive_definite") from None
