"""Methods for the natural modes of a system: their choice, their cost, and themselves."""

from __future__ import annotations

import hashlib
import weakref
from enum import StrEnum
from typing import Final

import numpy as np
import scipy.linalg
from scipy.linalg import lapack

from vibroimpact_solvers.arrays import EPS, Floats, Integers
from vibroimpact_solvers.matrices import Form, SymmetricMatrix, frozen
from vibroimpact_solvers.model import ChainShape, System
from vibroimpact_solvers.plan import Stage, Step
from vibroimpact_solvers.spectrum.cache import CACHE
from vibroimpact_solvers.spectrum.modes import Spectrum

MEMORY: Final = 16e9
"""Largest size of a spectrum, bytes."""

_HALF_PI = np.longdouble("1.5707963267948966192313216916397514421")


class Method(StrEnum):
    """Methods for the natural modes; the values are shown in plans."""

    CLOSED_FORM = "closed form"
    DIAGONAL = "diagonal"
    TRIDIAGONAL = "tridiagonal"
    BANDED = "banded"
    DENSE = "dense"


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
    if system.M.form is not Form.DIAGONAL:
        return Method.DENSE
    return {
        Form.DIAGONAL: Method.DIAGONAL,
        Form.TRIDIAGONAL: Method.TRIDIAGONAL,
        Form.BANDED: Method.BANDED,
    }.get(system.K.form, Method.DENSE)


def flops(system: System, method: Method) -> float:
    """Estimated floating-point operations of a method."""
    n = float(system.n)
    return {
        Method.CLOSED_FORM: 20.0 * n,
        Method.DIAGONAL: n,
        Method.TRIDIAGONAL: 6.0 * n * n + 2.0 * n**3,
        Method.BANDED: 12.0 * n**3,
        Method.DENSE: 14.0 * n**3,
    }[method]


def nbytes(system: System, method: Method) -> float:
    """Memory of a spectrum, bytes."""
    n = float(system.n)
    return 8.0 * n if method in {Method.CLOSED_FORM, Method.DIAGONAL} else 8.0 * n * (n + 1)


def step(system: System, method: Method) -> Step:
    """Return the step of a plan for the natural modes, at no cost where they are cached."""
    known = _key(system, method) in CACHE
    return Step(
        Stage.SPECTRUM,
        method,
        _REASONS[method] + ("; already computed" if known else ""),
        0.0 if known else flops(system, method),
        nbytes(system, method),
    )


def _key(system: System, method: Method) -> bytes:
    """Return the key of a system's spectrum: a hash of all that it depends on."""
    keys = _KEYS.setdefault(system, {})
    if method not in keys:
        text = hashlib.blake2b(method.encode())
        text.update(system.M.digest())
        text.update(system.K.digest())
        keys[method] = text.digest()
    return keys[method]


_KEYS: weakref.WeakKeyDictionary[System, dict[Method, bytes]] = weakref.WeakKeyDictionary()


def spectrum(system: System, method: Method | None = None) -> Spectrum:
    """Return all natural modes of a system from the cache, or by a method, else the cheapest."""
    chosen = choose(system) if method is None else method
    return CACHE.get(_key(system, chosen), lambda: _compute(system, chosen))


def _compute(system: System, method: Method) -> Spectrum:
    if method is Method.CLOSED_FORM and system.chain is not None:
        return _chain(system.chain)
    if method is Method.DIAGONAL:
        return _diagonal(system.M.data[0], system.K.data[0])
    if method is Method.DENSE:
        eigenvalues, modes = scipy.linalg.eigh(
            system.K.to_dense(), system.M.to_dense(), check_finite=False
        )
        magnitude, condition = _full(system)
        return _numerical(np.asarray(eigenvalues), np.asarray(modes), magnitude, condition)
    eigenvalues, modes = _mass_scaled(system.M.data[0], system.K, method)
    return _numerical(np.asarray(eigenvalues), np.asarray(modes))


def _full(system: System) -> tuple[float, float]:
    """Return the magnitudes that rounding errors are relative to for full M and K.

    Errors of the eigenvalues are relative to ``|K| |M^-1|`` with the diagonal of M scaled to
    ones, as elimination does not depend on such a scaling: more than the largest eigenvalue
    where M is close to singular. Errors of the norms of the modes are relative to the condition
    number of the scaled M.
    """
    M, K = system.M.to_dense(), system.K.to_dense()
    scale = 1.0 / np.sqrt(np.diagonal(M))
    outer = np.outer(scale, scale)
    factor, _ = lapack.dpotrf(M * outer)
    size = float(np.linalg.norm(M * outer, 1))
    reciprocal, _ = lapack.dpocon(factor, size)
    condition = 1.0 / max(float(reciprocal), EPS)
    return float(np.linalg.norm(K * outer, 1)) * condition / size, condition


def _numerical(
    eigenvalues: Floats, modes: Floats, magnitude: float = 0.0, condition: float = 1.0
) -> Spectrum:
    """Return a spectrum whose eigenvalues are known to a few roundings of the largest."""
    n = eigenvalues.size
    scale = max(float(np.abs(eigenvalues).max()), magnitude)
    # A computed eigenvalue below it is rounding noise: a rigid-body mode.
    floor = max(16.0, np.sqrt(n)) * EPS * scale
    noise = np.abs(eigenvalues) <= floor
    eigenvalues[noise] = 0.0
    columns = frozen(np.ascontiguousarray(modes))
    uncertainty = floor if noise.any() else 2.0 * EPS * scale
    return Spectrum(_roots(eigenvalues), columns, n, uncertainty, norms=(1.0 + condition) * EPS)


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
    # Rounded once: a rounded factor would scale all modes alike.
    factor = np.sqrt(2 / (size * np.longdouble(shape.mass)))
    entries = (factor * sines[::2]).astype(np.float64)

    def rows(dofs: Integers) -> Floats:
        turns = np.outer(dofs + 1, j) % (2 * size)
        sign = np.where(turns >= size, -1.0, 1.0)
        turns %= size
        turns = np.minimum(turns, size - turns)
        return np.asarray(sign * entries[turns])

    return Spectrum(frozen(frequencies), rows, shape.n, rounding=frozen(rounding))


def _diagonal(mass: Floats, stiffness: Floats) -> Spectrum:
    """Modes of uncoupled coordinates."""
    eigenvalues = stiffness / mass
    order = np.argsort(eigenvalues, kind="stable")
    place = np.empty_like(order)
    place[order] = np.arange(mass.size)

    def rows(dofs: Integers) -> Floats:
        entries = np.zeros((dofs.size, mass.size))
        entries[np.arange(dofs.size), place[dofs]] = 1.0 / np.sqrt(mass[dofs])
        return entries

    return Spectrum(_roots(eigenvalues[order]), rows, mass.size)


def _mass_scaled(mass: Floats, K: SymmetricMatrix, method: Method) -> tuple[Floats, Floats]:
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
    return np.asarray(pairs[0]), np.asarray(pairs[1]) / root[:, np.newaxis]
