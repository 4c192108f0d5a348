"""Methods for the natural modes of a system: their choice, their cost, and themselves."""

from __future__ import annotations

import hashlib
import math
import weakref
from dataclasses import replace
from enum import StrEnum
from typing import Final

import flint
import numpy as np
import scipy.linalg
from scipy.linalg import lapack

from vibroimpact_solvers import condensation
from vibroimpact_solvers import precision as precise
from vibroimpact_solvers.arrays import EPS, Floats, Integers
from vibroimpact_solvers.body import Body
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.kernels import doubled
from vibroimpact_solvers.matrices import Form, SymmetricMatrix, frozen
from vibroimpact_solvers.model import ChainShape, System
from vibroimpact_solvers.plan import Stage, Step
from vibroimpact_solvers.spectrum import inertia, refinement, rounded_modes, static_rows
from vibroimpact_solvers.spectrum.cache import CACHE
from vibroimpact_solvers.spectrum.modes import Spectrum

MEMORY: Final = 16e9
"""Largest size of a spectrum, bytes."""

_EXACT_CHAIN: Final = 1024
"""Masses of a chain up to which its frequencies are computed in ball arithmetic."""
_SMALL = 1e-10  # eigenvalues below this part of the largest may be noise
_NOISE = 4.0  # roundings of a mode's own elastic terms below which it counts as rigid
_HALF_PI = np.longdouble("1.5707963267948966192313216916397514421")


class Method(StrEnum):
    """Methods for the natural modes; the values are shown in plans."""

    CLOSED_FORM = "closed form"
    DIAGONAL = "diagonal"
    TRIDIAGONAL = "tridiagonal"
    BANDED = "banded"
    DENSE = "dense"
    CONDENSED = "static condensation"


_REASONS: Final = {
    Method.CLOSED_FORM: "a uniform chain has its modes in closed form (eq. 10.63)",
    Method.DIAGONAL: "M and K are diagonal: the coordinates are the modes",
    Method.TRIDIAGONAL: "M is diagonal and K tridiagonal",
    Method.BANDED: "M is diagonal and K banded",
    Method.DENSE: "M and K have no narrower structure",
}


def choose(system: System) -> Method:
    """Return the cheapest method for all modes that the structure of the system allows."""
    if system.chain is not None:
        return Method.CLOSED_FORM
    if system.massless.size:
        return Method.CONDENSED
    if system.M.form is not Form.DIAGONAL:
        return Method.DENSE
    return {
        Form.DIAGONAL: Method.DIAGONAL,
        Form.TRIDIAGONAL: Method.TRIDIAGONAL,
        Form.BANDED: Method.BANDED,
    }.get(system.K.form, Method.DENSE)


def flops(system: System, method: Method) -> float:
    """Estimated floating-point operations of a method, those of the refinement included.

    Work on single rows and columns takes far longer than products of matrices: it counts as so many
    operations for each of the n^2 entries, as measured up to n = 900.
    """
    n = float(system.n)
    if method is Method.CONDENSED:
        massive = n - system.massless.size
        balls = 100.0 if system.n <= refinement.LARGEST else 0.0  # flops of an operation of FLINT
        return 14.0 * massive**3 + (1.0 + balls) * condensation.flops(system)
    return {
        Method.CLOSED_FORM: 20.0 * n,
        Method.DIAGONAL: n,
        Method.TRIDIAGONAL: 2.0 * n**3 + 3.3e3 * n * n,
        Method.BANDED: 12.0 * n**3 + 8.5e3 * n * n,
        Method.DENSE: 14.0 * n**3 + 4.7e3 * n * n,
    }[method]


def factor_flops(system: System) -> float:
    """Return the operations of one factorization at a frequency and one solve."""
    width = max(system.M.width, system.K.width)
    if Form.SPARSE in {system.M.form, system.K.form}:
        # Nested dissection of a planar mesh; three-dimensional ones cost more.
        return 20.0 * math.pow(system.n, 1.5)
    if Form.DENSE in {system.M.form, system.K.form}:
        return float(system.n) ** 3
    return 4.0 * system.n * (width + 1) ** 2 + 50.0 * system.n


def solve_flops(system: System) -> float:
    """Return the operations of one solve with given factors."""
    width = max(system.M.width, system.K.width)
    if Form.SPARSE in {system.M.form, system.K.form}:
        return 200.0 * system.n
    if Form.DENSE in {system.M.form, system.K.form}:
        return 2.0 * float(system.n) ** 2
    return 8.0 * system.n * (width + 2)


def nbytes(system: System, method: Method) -> float:
    """Memory of a spectrum, bytes."""
    n = float(system.n)
    if method is Method.CONDENSED:
        massive = n - system.massless.size
        return 8.0 * massive * (n + massive + 1.0)
    return 8.0 * n if method in {Method.CLOSED_FORM, Method.DIAGONAL} else 8.0 * n * (n + 1)


def step(system: System, method: Method) -> Step:
    """Return the step of a plan for the natural modes, at no cost where they are cached."""
    known = _key(system, method) in CACHE
    reason = (
        f"{condensation.sentence(system)}; the natural modes are those of the others"
        if method is Method.CONDENSED
        else _REASONS[method]
    )
    return Step(
        Stage.SPECTRUM,
        method,
        reason + ("; already computed" if known else ""),
        0.0 if known else flops(system, method),
        nbytes(system, method),
    )


def _key(system: System, method: Method) -> bytes:
    """Return the key of a system's spectrum: a hash of all that it depends on."""
    keys = _KEYS.setdefault(system.body, {})
    if method not in keys:
        text = hashlib.blake2b(method.encode())
        text.update(system.M.digest())
        text.update(system.K.digest())
        keys[method] = text.digest()
    return keys[method]


_KEYS: weakref.WeakKeyDictionary[Body, dict[Method, bytes]] = weakref.WeakKeyDictionary()


def spectrum(system: System, method: Method | None = None) -> Spectrum:
    """Return all natural modes of a system from the cache, or by a method, else the cheapest."""
    chosen = choose(system) if method is None else method
    return CACHE.get(_key(system, chosen), lambda: _compute(system, chosen))


def _compute(system: System, method: Method) -> Spectrum:
    if method is Method.CLOSED_FORM and system.chain is not None:
        return _chain(system.chain)
    if method is Method.DIAGONAL:
        return _diagonal(system.M.data[0], system.K.data[0])
    if method is Method.CONDENSED:
        return _condensed(system)
    if method is Method.DENSE:
        _, modes = scipy.linalg.eigh(system.K.to_dense(), system.M.to_dense(), check_finite=False)
    else:
        modes = _mass_scaled(system.M.data[0], system.K, method)
    if system.n <= refinement.LARGEST:
        stiffness = refinement.Stiffness(system.K.to_dense())
        return _refined(system, refinement.refine(_mass(system.M), stiffness, np.asarray(modes)))
    try:
        least = inertia.least_eigenvalue(system.M)
        refined = rounded_modes.refine(system.M, system.K, np.asarray(modes), least)
    except ConvergenceError:
        refined = None  # M is too close to a singular one
    if refined is not None and np.isfinite(refined.angles).all():
        return _refined(system, refined)
    magnitude, condition = _full(system.M, system.K) if method is Method.DENSE else (0.0, 1.0)
    return _numerical(system, np.asarray(modes), magnitude, condition)


def _condensed(system: System) -> Spectrum:
    """Natural modes of the condensed structure, with the rows of what has no mass."""
    if system.n <= refinement.LARGEST:
        return _refined(system, static_rows.refined(system))
    modes, error = static_rows.in_doubles(system)
    condensed = condensation.of(system)
    natural = _numerical(system, modes, *_full(condensed.M, condensed.sizes))
    assert natural.angles is not None
    return replace(natural, angles=np.minimum(natural.angles + error, 1.0))


def sensitivity(system: System, natural: Spectrum) -> tuple[float, float]:
    """Return how roundings of the entries of M and K change eigenvalues and modes.

    An absolute error of the eigenvalues, and a relative one, which is also that of the norms of
    the modes; for structures whose matrices were computed.
    """
    method = choose(system)
    if method in {Method.CLOSED_FORM, Method.DIAGONAL}:
        return 0.0, 0.0
    magnitude, condition = 0.0, 1.0
    if method is Method.DENSE:
        magnitude, condition = _full(system.M, system.K)
    elif method is Method.CONDENSED:
        condensed = condensation.of(system)
        magnitude, condition = _full(condensed.M, condensed.sizes)
    scale = max(natural.largest_frequency**2, magnitude)
    return max(natural.uncertainty, 2.0 * EPS * scale), (1.0 + condition) * EPS


def _mass(M: SymmetricMatrix) -> Floats:
    """Return a mass matrix as `refinement` takes it."""
    return M.data[0] if M.form is Form.DIAGONAL else M.to_dense()


def _refined(system: System, refined: refinement.RefinedModes) -> Spectrum:
    """Return a spectrum with proved errors."""
    values, low, errors = refined.eigenvalues, refined.eigenvalues_low, refined.errors
    rigid = np.abs(values) <= errors
    small = np.flatnonzero(np.abs(values) <= _SMALL * np.abs(values).max())
    if small.size:
        own = _own_sizes(system.K, refined.modes[:, small])
        rigid[small] |= np.abs(values[small]) <= _NOISE * EPS * own
    errors = np.where(rigid, errors + np.abs(values), errors)
    order = np.argsort(np.where(rigid, 0.0, values), kind="stable")
    low_part = refined.modes_low[:, order] if refined.modes_low.size else refined.modes_low
    roots, rests = doubled.roots(np.where(rigid, 0.0, values)[order], low[order])
    return Spectrum(
        frozen(roots),
        frozen(np.ascontiguousarray(refined.modes[:, order])),
        system.n,
        float(errors.max(initial=0.0)),
        rounding=frozen(rests),
        errors=frozen(errors[order]),
        angles=frozen(refined.angles[order]),
        modal_matrix_low=frozen(np.ascontiguousarray(low_part)) if low_part.size else None,
    )


def _own_sizes(K: SymmetricMatrix, modes: Floats) -> Floats:
    """Return ``|e|^T |K| |e|`` of each mode e, (mode,)."""
    magnitudes, stiffness = np.abs(modes), replace(K, data=np.abs(K.data))
    return np.asarray((magnitudes * (stiffness @ magnitudes)).sum(axis=0))


def _full(mass: SymmetricMatrix, stiffness: SymmetricMatrix) -> tuple[float, float]:
    """Return the magnitudes that rounding errors are relative to for full M and K.

    Errors of the eigenvalues are relative to ``|K| |M^-1|`` with the diagonal of M scaled to
    ones, as elimination does not depend on such a scaling: more than the largest eigenvalue
    where M is close to singular. Errors of the norms of the modes are relative to the condition
    number of the scaled M.
    """
    M, K = mass.to_dense(), stiffness.to_dense()
    scale = 1.0 / np.sqrt(np.diagonal(M))
    outer = np.outer(scale, scale)
    factor, _ = lapack.dpotrf(M * outer)
    size = float(np.linalg.norm(M * outer, 1))
    reciprocal, _ = lapack.dpocon(factor, size)
    condition = 1.0 / max(float(reciprocal), EPS)
    return float(np.linalg.norm(K * outer, 1)) * condition / size, condition


def _numerical(system: System, modes: Floats, magnitude: float, condition: float) -> Spectrum:
    """Return a spectrum whose eigenvalues are known to a few roundings of the largest."""
    count = modes.shape[1]
    eigenvalues = (modes * (system.K @ modes)).sum(axis=0)
    eigenvalues /= (modes * (system.M @ modes)).sum(axis=0)
    scale = max(float(np.abs(eigenvalues).max()), magnitude)
    # One below the errors of its own terms is a rigid-body mode.
    small = np.flatnonzero(np.abs(eigenvalues) <= max(16.0, np.sqrt(count)) * EPS * scale)
    own = _own_sizes(system.K, modes[:, small])
    rigid = small[np.abs(eigenvalues[small]) <= _NOISE * np.sqrt(count) * EPS * own]
    eigenvalues[rigid] = 0.0
    order = np.argsort(eigenvalues, kind="stable")
    roots = _roots(eigenvalues[order])
    errors = np.full(count, (max(16.0, np.sqrt(count)) if rigid.size else 2.0) * EPS * scale)
    gaps = np.full(count + 1, np.inf)
    gaps[1:-1] = np.diff(eigenvalues[order])
    gap = np.minimum(gaps[:-1], gaps[1:])
    angles = 2.0 * EPS * scale / np.maximum(gap, EPS * scale) + (1.0 + condition) * EPS
    return Spectrum(
        roots,
        frozen(np.ascontiguousarray(modes[:, order])),
        system.n,
        float(errors.max()),
        norms=(1.0 + condition) * EPS,
        errors=errors,
        angles=np.minimum(angles, 1.0),
        proved=False,
    )


def _roots(eigenvalues: Floats) -> Floats:
    return np.asarray(frozen(np.sign(eigenvalues) * np.sqrt(np.abs(eigenvalues))))


def _chain(shape: ChainShape) -> Spectrum:
    """Modes of the uniform chain between fixed ends, eq. 10.63.

    The sines are taken of arguments reduced in integers, so that mirror-image entries are
    equal to the last bit and entries that vanish are zero.
    """
    size = shape.n + 1
    j = np.arange(1, shape.n + 1)
    # Extended precision, where there is any, yields the rounding errors of the frequencies.
    angle = j.astype(np.longdouble) * (_HALF_PI / size)
    omega0 = np.sqrt(np.longdouble(shape.stiffness) / np.longdouble(shape.mass))
    sines = np.concatenate([[0.0], np.sin(angle), [1.0]])
    exact = 2.0 * omega0 * sines[1:size]
    frequencies = exact.astype(np.float64)
    rounding = ((exact - frequencies) / exact).astype(np.float64)
    precision = float(np.finfo(np.longdouble).eps)
    if shape.n <= _EXACT_CHAIN:
        frequencies, rounding = _exact_chain_frequencies(shape)
        precision = EPS * EPS
    # Rounded once: a rounded factor would scale all modes alike.
    factor = np.sqrt(2 / (size * np.longdouble(shape.mass)))
    entries = (factor * sines[::2]).astype(np.float64)

    def rows(dofs: Integers) -> Floats:
        turns = np.outer(dofs + 1, j) % (2 * size)
        sign = np.where(turns >= size, -1.0, 1.0)
        turns %= size
        turns = np.minimum(turns, size - turns)
        return np.asarray(sign * entries[turns])

    errors = 8.0 * precision * np.square(frequencies)
    return Spectrum(
        frozen(frequencies),
        rows,
        shape.n,
        float(errors.max()),
        rounding=frozen(rounding),
        errors=frozen(errors),
    )


def _exact_chain_frequencies(shape: ChainShape) -> tuple[Floats, Floats]:
    """Return the natural frequencies and what rounding took from them, relative to them."""
    frequencies, rounding = np.empty((2, shape.n))
    with precise.working(160):
        factor = 2 * (flint.arb(shape.stiffness) / flint.arb(shape.mass)).sqrt()
        for j in range(shape.n):
            exact = factor * flint.arb.sin_pi_fmpq(flint.fmpq(j + 1, 2 * shape.n + 2))
            frequencies[j] = rounded = float(exact.mid())
            rounding[j] = float(((exact - rounded) / exact).mid())
    return frequencies, rounding


def _diagonal(mass: Floats, stiffness: Floats) -> Spectrum:
    """Modes of uncoupled coordinates."""
    eigenvalues, rests = doubled.quotients(np.array(stiffness), np.array(mass))
    order = np.argsort(eigenvalues, kind="stable")
    place = np.empty_like(order)
    place[order] = np.arange(mass.size)

    def rows(dofs: Integers) -> Floats:
        entries = np.zeros((dofs.size, mass.size))
        entries[np.arange(dofs.size), place[dofs]] = 1.0 / np.sqrt(mass[dofs])
        return entries

    roots, rounding = doubled.roots(eigenvalues[order], rests[order])
    return Spectrum(frozen(roots), rows, mass.size, rounding=frozen(rounding))


def _mass_scaled(mass: Floats, K: SymmetricMatrix, method: Method) -> Floats:
    """Modes for a diagonal M, from the matrix M^(-1/2) K M^(-1/2) of K's own structure."""
    root = np.sqrt(mass)
    scaled = np.zeros_like(K.data)
    for k, band in enumerate(K.data):
        end = mass.size - k
        scaled[k, :end] = band[:end] / (root[:end] * root[k:])
    if method is Method.TRIDIAGONAL:
        pairs = scipy.linalg.eigh_tridiagonal(scaled[0], scaled[1, :-1], check_finite=False)
    else:
        pairs = scipy.linalg.eig_banded(scaled, lower=True, check_finite=False)
    return np.asarray(pairs[1]) / root[:, np.newaxis]
