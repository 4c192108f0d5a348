"""Impulses of the odd family from the modal response, eq. 10.53 and 10.87-10.89.

Near ``cos(gamma_j) = 0`` the response matrix S has a pole that drowns everything else in it.
A mode close to its pole is therefore not summed into S but keeps an unknown of its own,

    d_j = (e_j^T W^T p) / cos(gamma_j),

and one more equation, ``(W e_j)^T p = cos(gamma_j) d_j``: the bordered system stays well
conditioned through the pole.
"""

from __future__ import annotations

import math

import numpy as np

from vibroimpact_solvers.arrays import Booleans, Floats
from vibroimpact_solvers.kernels.jit import kernel
from vibroimpact_solvers.kernels.triangle_time import (
    inverse_cosine,
    sensitivity,
    sine_ratio,
    tangent_ratio,
)

# A mode with |cos gamma| below it is bordered: summed, it could cost 1/_NEAR of the digits.
_NEAR = 1.0 / 16.0
_EPS = 2.220446049250313e-16


@kernel
def impulse_one(lam: Floats, weight2: Floats, omega: Floats, gap: float) -> tuple[Floats, Floats]:
    """Impulses of one constraint, eq. 10.53.

    Parameters
    ----------
    lam : array, shape (mode,)
        Eigenvalues.
    weight2 : array, shape (mode,)
        Squares of ``w^T e_j``.
    omega : array, shape (frequency,)
        Triangle-wave frequencies.
    gap : float
        Gap on both sides.

    Returns
    -------
    p, condition : array, shape (frequency,)
        Impulse parameter (0 where the response is infinite, nan where it vanishes), and by
        how much relative errors of the data are magnified in it.
    """
    p = np.empty(omega.size)
    condition = np.empty(omega.size)
    for f in range(omega.size):
        total = 0.0
        spread = 0.0
        scale = 1.0 / omega[f]
        for j in range(lam.size):
            mu = lam[j] * scale * scale
            term = weight2[j] * tangent_ratio(mu)
            total += term
            spread += abs(term) * sensitivity(mu)
        if total == 0.0:
            p[f] = np.nan
            condition[f] = np.inf
        else:
            p[f] = gap * omega[f] * omega[f] / total
            condition[f] = spread / abs(total)
    return p, condition


@kernel
def impulses(
    lam: Floats, rows: Floats, omega: Floats, gaps: Floats
) -> tuple[Floats, Floats, Floats]:
    """Impulses of any number of constraints from the bordered system.

    Parameters
    ----------
    lam : array, shape (mode,)
        Eigenvalues.
    rows : array, shape (constraint, mode)
        ``W E``.
    omega : array, shape (frequency,)
        Triangle-wave frequencies.
    gaps : array, shape (constraint,)
        Gaps on both sides.

    Returns
    -------
    p : array, shape (frequency, constraint)
        Impulse parameters; nan where the system is singular.
    condition : array, shape (frequency,)
        Magnification of relative errors of the data in p, in the largest component.
    d : array, shape (frequency, mode)
        Modal amplitudes ``(e_j^T W^T p)/cos(gamma_j)``, finite through the poles.
    """
    count, modes = rows.shape
    p = np.empty((omega.size, count))
    condition = np.empty(omega.size)
    d = np.zeros((omega.size, modes))
    near = np.empty(modes, dtype=np.int64)
    for f in range(omega.size):
        scale = 1.0 / omega[f]
        m = count
        for j in range(modes):
            mu = lam[j] * scale * scale
            if mu > 0.0 and abs(math.cos(math.sqrt(mu))) < _NEAR:
                near[m - count] = j
                m += 1
        matrix, wobble = _bordered(lam, rows, scale, near[: m - count])
        right = np.zeros(m)
        right[:count] = gaps * omega[f] * omega[f]
        inverse, sound = _inverse(matrix)
        if not sound:
            p[f] = np.nan
            condition[f] = np.inf
            continue
        z = np.dot(inverse, right)
        z += np.dot(inverse, right - np.dot(matrix, z))
        p[f] = z[:count]
        error = np.dot(np.abs(inverse), np.dot(wobble, np.abs(z)))
        condition[f] = 1.0 + np.max(error[:count]) / max(np.max(np.abs(z[:count])), 1e-300)
        for j in range(modes):
            b = 0.0
            for a in range(count):
                b += rows[a, j] * z[a]
            d[f, j] = b * inverse_cosine(lam[j] * scale * scale)
        for k in range(m - count):
            d[f, near[k]] = z[count + k]
    return p, condition, d


@kernel
def _bordered(lam: Floats, rows: Floats, scale: float, near: np.ndarray) -> tuple[Floats, Floats]:
    """Return the bordered matrix and the size of its change per relative change of the data."""
    count, modes = rows.shape
    m = count + near.size
    matrix = np.zeros((m, m))
    wobble = np.zeros((m, m))
    k = 0
    for j in range(modes):
        mu = lam[j] * scale * scale
        if k < near.size and near[k] == j:
            gamma = math.sqrt(mu)
            sine, cosine = math.sin(gamma), math.cos(gamma)
            border = count + k
            matrix[border, border] = -cosine
            wobble[border, border] = abs(cosine) + gamma * abs(sine)
            for a in range(count):
                matrix[a, border] = rows[a, j] * sine / gamma
                matrix[border, a] = rows[a, j]
                wobble[a, border] = abs(rows[a, j]) * (abs(cosine) + abs(sine) / gamma)
                wobble[border, a] = abs(rows[a, j])
            k += 1
        else:
            response = tangent_ratio(mu)
            change = abs(response) * sensitivity(mu)
            for a in range(count):
                for b in range(count):
                    product = rows[a, j] * rows[b, j]
                    matrix[a, b] += product * response
                    wobble[a, b] += abs(product) * change
    return matrix, wobble


@kernel
def _inverse(matrix: Floats) -> tuple[Floats, bool]:
    """Invert a small matrix by Gauss-Jordan elimination with complete row pivoting."""
    m = matrix.shape[0]
    work = matrix.copy()
    inverse = np.eye(m)
    largest = np.max(np.abs(matrix))
    for column in range(m):
        pivot = column
        for row in range(column + 1, m):
            if abs(work[row, column]) > abs(work[pivot, column]):
                pivot = row
        if abs(work[pivot, column]) <= _EPS * _EPS * largest:
            return inverse, False
        for k in range(m):
            work[column, k], work[pivot, k] = work[pivot, k], work[column, k]
            inverse[column, k], inverse[pivot, k] = inverse[pivot, k], inverse[column, k]
        factor = 1.0 / work[column, column]
        for k in range(m):
            work[column, k] *= factor
            inverse[column, k] *= factor
        for row in range(m):
            if row != column and work[row, column] != 0.0:
                factor = work[row, column]
                for k in range(m):
                    work[row, k] -= factor * work[column, k]
                    inverse[row, k] -= factor * inverse[column, k]
    return inverse, True


@kernel
def amplitudes(lam: Floats, rows: Floats, omega: Floats, p: Floats) -> Floats:
    """Modal amplitudes ``(e_j^T W^T p)/cos(gamma_j)`` of one constraint, shape (frequency, mode).

    With one constraint p vanishes at a pole as the cosine does, and their quotient is exact.
    """
    d = np.empty((omega.size, lam.size))
    for f in range(omega.size):
        scale = 1.0 / omega[f]
        for j in range(lam.size):
            d[f, j] = rows[0, j] * p[f, 0] * inverse_cosine(lam[j] * scale * scale)
    return d


@kernel
def displacements(
    lam: Floats,
    modes: Floats,
    omega: Floats,
    d: Floats,
    b: Floats,
    tau: Floats,
    wanted: Booleans,
) -> Floats:
    """Displacements from modal amplitudes, eq. 10.87.

    Parameters
    ----------
    lam : array, shape (mode,)
    modes : array, shape (dof, mode)
        Rows of the modal matrix for the wanted degrees of freedom.
    omega : array, shape (frequency,)
    d, b : array, shape (frequency, mode)
        Amplitudes with and without the cosine.
    tau : array, shape (tau,)
    wanted : array of bool, shape (mode,)
        Modes that take part.

    Returns
    -------
    array, shape (frequency, tau, dof)
    """
    x = np.zeros((omega.size, tau.size, modes.shape[0]))
    for f in range(omega.size):
        scale = 1.0 / omega[f]
        for j in range(lam.size):
            if not wanted[j]:
                continue
            mu = lam[j] * scale * scale
            amplitude = (d[f, j] if mu >= 0.0 else b[f, j]) * scale * scale
            for t in range(tau.size):
                q = amplitude * sine_ratio(mu, tau[t])
                for n in range(modes.shape[0]):
                    x[f, t, n] += modes[n, j] * q
    return x


@kernel
def energies(lam: Floats, omega: Floats, d: Floats) -> Floats:
    """Total energies, ``sum_j d_j^2 / (2 omega^2)``, shape (frequency,)."""
    total = np.zeros(omega.size)
    for f in range(omega.size):
        for j in range(lam.size):
            total[f] += 0.5 * (d[f, j] / omega[f]) ** 2
    return total
