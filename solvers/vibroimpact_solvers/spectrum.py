"""Natural modes of a structure, by the method that its matrices allow, computed once."""

from __future__ import annotations

import hashlib
import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np
import scipy.linalg

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.model import ChainShape, Form, SymmetricMatrix, System


class Method(StrEnum):
    """How the natural modes are found; the values are what a plan shows."""

    CLOSED_FORM = "closed form"
    DIAGONAL = "diagonal"
    TRIDIAGONAL = "tridiagonal"
    BANDED = "banded"
    DENSE = "dense"


REASONS: Final = {
    Method.CLOSED_FORM: "a uniform chain has its modes in closed form (eq. 10.63)",
    Method.DIAGONAL: "M and K are diagonal: the coordinates are the modes",
    Method.TRIDIAGONAL: "M is diagonal and K tridiagonal",
    Method.BANDED: "M is diagonal and K banded",
    Method.DENSE: "M and K have no narrower structure",
}


@dataclass(frozen=True, eq=False, slots=True)
class Spectrum:
    """Natural modes, ``K e_j = lambda_j M e_j``, ``e_i^T M e_j = delta_ij``.

    Parameters
    ----------
    eigenvalues : array, shape (mode,)
        Ascending.
    modes : array, shape (dof, mode)
        The e_j are its columns.
    """

    eigenvalues: Floats
    modes: Floats

    @property
    def nbytes(self) -> int:
        """Memory held."""
        return self.eigenvalues.nbytes + self.modes.nbytes


def choose(system: System) -> Method:
    """Return the cheapest method that the structure of the system allows."""
    if system.chain is not None:
        return Method.CLOSED_FORM
    if system.M.form is not Form.DIAGONAL or system.K.form is Form.DENSE:
        return Method.DENSE
    return {
        Form.DIAGONAL: Method.DIAGONAL,
        Form.TRIDIAGONAL: Method.TRIDIAGONAL,
        Form.BANDED: Method.BANDED,
    }[system.K.form]


def flops(system: System, method: Method) -> float:
    """Estimated floating-point operations of a method."""
    n = float(system.n)
    return {
        Method.CLOSED_FORM: 20.0 * n * n,
        Method.DIAGONAL: n,
        Method.TRIDIAGONAL: 6.0 * n * n + 2.0 * n**3,
        Method.BANDED: 12.0 * n**3,
        Method.DENSE: 14.0 * n**3,
    }[method]


class Cache:
    """Spectra by the content of M and K, bounded by the memory they hold."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._held: OrderedDict[bytes, Spectrum] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, key: bytes, compute: Callable[[], Spectrum]) -> Spectrum:
        """Return the spectrum of that key, computing it where it is not held."""
        with self._lock:
            if key in self._held:
                self._held.move_to_end(key)
                return self._held[key]
        spectrum = compute()
        with self._lock:
            self._held[key] = spectrum
            while len(self._held) > 1 and sum(s.nbytes for s in self._held.values()) > self._limit:
                self._held.popitem(last=False)
        return spectrum

    def __contains__(self, key: bytes) -> bool:
        with self._lock:
            return key in self._held


CACHE: Final = Cache(512 * 2**20)


def key(system: System, method: Method) -> bytes:
    """Return the name of a system's spectrum: a hash of what it depends on."""
    text = hashlib.blake2b(method.encode())
    text.update(system.M.digest())
    text.update(system.K.digest())
    return text.digest()


def spectrum(system: System, method: Method) -> Spectrum:
    """Return the natural modes of a system by the method chosen for it."""
    return CACHE.get(key(system, method), lambda: _compute(system, method))


def _compute(system: System, method: Method) -> Spectrum:
    if method is Method.CLOSED_FORM and system.chain is not None:
        found = _chain(system.chain)
    elif method is Method.DENSE:
        found = _dense(system.M, system.K)
    else:
        found = _mass_scaled(system.M.data[0], system.K, method)
    for array in (found.eigenvalues, found.modes):
        array.setflags(write=False)
    return found


def _chain(shape: ChainShape) -> Spectrum:
    """Modes of the uniform chain between fixed ends, eq. 10.63.

    The sines are taken of arguments reduced in integers, so that mirror-image entries are
    equal to the last bit and entries that vanish are zero.
    """
    size = shape.n + 1
    j = np.arange(1, shape.n + 1)
    omega0 = np.sqrt(shape.stiffness / shape.mass)
    frequencies = 2.0 * omega0 * np.sin(np.pi * j / (2 * size))
    turns = np.outer(j, j) % (2 * size)
    sign = np.where(turns >= size, -1.0, 1.0)
    turns %= size
    turns = np.minimum(turns, size - turns)
    modes = sign * np.sqrt(2.0 / (size * shape.mass)) * np.sin(np.pi * turns / size)
    return Spectrum(frequencies**2, np.ascontiguousarray(modes))


def _dense(M: SymmetricMatrix, K: SymmetricMatrix) -> Spectrum:
    eigenvalues, modes = scipy.linalg.eigh(K.to_dense(), M.to_dense(), check_finite=False)
    return Spectrum(eigenvalues, np.ascontiguousarray(modes))


def _mass_scaled(mass: Floats, K: SymmetricMatrix, method: Method) -> Spectrum:
    """Modes for a diagonal M, from the matrix M^(-1/2) K M^(-1/2) of K's own structure."""
    root = np.sqrt(mass)
    scaled = np.zeros_like(K.data)
    for k, band in enumerate(K.data):
        end = mass.size - k
        scaled[k, :end] = band[:end] / (root[:end] * root[k:])
    if method is Method.DIAGONAL:
        order = np.argsort(scaled[0], kind="stable")
        eigenvalues, modes = scaled[0][order], np.eye(mass.size)[:, order]
    elif method is Method.TRIDIAGONAL:
        diagonal, off = scaled[0], scaled[1, :-1]
        found = scipy.linalg.eigh_tridiagonal(diagonal, off, check_finite=False)
        eigenvalues, modes = np.asarray(found[0], np.float64), np.asarray(found[1], np.float64)
    else:
        found = scipy.linalg.eig_banded(scaled, lower=True, check_finite=False)
        eigenvalues, modes = np.asarray(found[0], np.float64), np.asarray(found[1], np.float64)
    return Spectrum(eigenvalues, np.ascontiguousarray(modes / root[:, np.newaxis]))
