"""Impulses and amplitudes of the impact modes with one constraint, eq. 10.53, at many frequencies.

The response ``S = sum_j a_j^2 T(mu_j)``, omega^2 times the receptance, is summed for a block of
frequencies at a time, one frequency in each lane of the vector unit. Near a pole of a mode its
term outgrows the others and p goes through zero with it: finite, as no floating-point phase is a
pole. Phases are sums of two doubles, so that close to its poles p is as accurate as the data are.
"""

from __future__ import annotations

import math

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.jit import fma, kernel
from vibroimpact_solvers.kernels.phases import LARGEST, sine_cosine, tangent
from vibroimpact_solvers.kernels.threads import over_ranges

_EPS = 2.220446049250313e-16
_LANES = 64  # frequencies of a block
_PHASES = 512  # cosines of a block
_MODES = 32  # terms that are summed before their sum joins the total, against rounding


def impulses_of(S: Floats, omega: Floats, gap: float) -> Floats:
    """Return the impulses that bring a response of `response_one` to a gap, shape (frequency,)."""
    with np.errstate(over="ignore", invalid="ignore"):
        p = gap * omega * omega / S
    return np.where(np.isfinite(S), p, 0.0)


def amplitudes_one(
    roots: Floats,
    rests: Floats,
    row: Floats,
    omega: Floats,
    omega_rests: Floats,
    scale: Floats,
) -> Floats:
    """Return amplitudes of the motion that impulses at one coordinate cause.

    A solution of the family is ``q = D sin(gamma tau)/gamma``, eq. 10.48, with
    ``D = a gap/(S cos(gamma))``. Near a pole S grows as its mode's ``1/cos(gamma)`` does, and
    as both are functions of the same phase D is as accurate there as anywhere.

    Parameters
    ----------
    roots, rests, omega, omega_rests
        As of `response_one`.
    row : array, shape (mode,)
        ``w^T e_j``.
    scale : array, shape (set, frequency)
        Gaps over the response; where it is 0 nothing moves.

    Returns
    -------
    D : array, shape (set, frequency, mode)
        Of unstable modes, the D of ``D sinh(g tau)/(g cosh(g))``.
    """
    D = np.empty((scale.shape[0], omega.size, roots.size))

    def piece(start: int, stop: int) -> None:
        some = slice(start, stop)
        _amplitudes_one(
            roots, rests, row, omega[some], omega_rests[some], scale[:, some], D[:, some]
        )

    over_ranges(piece, omega.size, 2.0 * D.size)
    return D


@kernel
def _amplitudes_one(
    roots: Floats,
    rests: Floats,
    row: Floats,
    omega: Floats,
    omega_rest: Floats,
    scale: Floats,
    D: Floats,
) -> None:
    modes, root = roots.size, np.maximum(roots, 0.0)
    root_rest = root * rests
    step = max(1, _PHASES // max(modes, 1))
    phase, rest = np.empty((step, modes)), np.empty((step, modes))
    for first in range(0, omega.size, step):
        last = min(first + step, omega.size)
        for f in range(first, last):
            q = 1.0 / omega[f]
            q_rest = q * (fma(-q, omega[f], 1.0) - omega_rest[f])
            for j in range(modes):
                x = root[j] * q
                lost = fma(root[j], q_rest, fma(root[j], q, -x))
                phase[f - first, j] = x
                rest[f - first, j] = fma(root_rest[j], q, lost)
        count = (last - first) * modes
        _secants(phase.reshape(-1)[:count], rest.reshape(-1)[:count])
        for s in range(scale.shape[0]):
            for f in range(first, last):
                if scale[s, f] == 0.0:
                    D[s, f] = 0.0
                    continue
                for j in range(modes):
                    D[s, f, j] = row[j] * scale[s, f] * phase[f - first, j]


@kernel
def _secants(phase: Floats, rest: Floats) -> None:
    """Replace phases by 1/cos."""
    for i in range(phase.size):
        phase[i] = 1.0 / sine_cosine(phase[i], rest[i])[1]


def response_one(
    roots: Floats,
    rests: Floats,
    weight2: Floats,
    omega: Floats,
    omega_rests: Floats,
    uncertainty: float = 0.0,
    norms: float = 0.0,
) -> tuple[Floats, Floats]:
    """Responses of one constrained coordinate to impulses at it.

    Parameters
    ----------
    roots : array, shape (mode,)
        Natural frequencies, zero for rigid-body modes; minus the growth rate of unstable ones.
    rests : array, shape (mode,)
        What rounding took from them, relative to them.
    weight2 : array, shape (mode,)
        Squares of ``w^T e_j``.
    omega : array, shape (frequency,)
        Triangle-wave frequencies, positive, rad per unit of time.
    omega_rests : array, shape (frequency,)
        What rounding took from them, relative to them.
    uncertainty : float
        Absolute error of the eigenvalues, beside the relative one of rounding. It may be that
        of the matrices: an error of the modes changes the response no more than that of all
        eigenvalues by the same amount.
    norms : float
        Error of the modes' norms and of their orthogonality, and relative one of eigenvalues,
        beside that of rounding.

    Returns
    -------
    S, condition : array, shape (frequency,)
        ``omega^2`` times the response, and by how much relative errors of the natural
        frequencies and weights are magnified in it. Both are infinite where the response
        vanishes, so that no impulse reaches the wall, or the phases of the modes are unknown.
    """
    S, condition = np.empty((2, omega.size))

    def piece(start: int, stop: int) -> None:
        some = slice(start, stop)
        _response_one(
            roots,
            rests,
            weight2,
            omega[some],
            omega_rests[some],
            uncertainty,
            2.0 + norms / _EPS,
            S[some],
            condition[some],
        )

    over_ranges(piece, omega.size, float(roots.size) * omega.size)
    return S, condition


@kernel
def _sorted(roots: Floats, weight2: Floats) -> tuple[Integers, Integers, float]:
    """Return the stable and the unstable modes, and the sum of squares of the rigid-body ones.

    The latter are so soft that their tangent is its argument at any frequency.
    """
    stable, unstable = np.empty(roots.size, np.int64), np.empty(roots.size, np.int64)
    stable_count, unstable_count, mass = 0, 0, 0.0
    for j in range(roots.size):
        if not np.isfinite(weight2[j] / abs(roots[j])):
            mass += weight2[j]
        elif roots[j] > 0.0:
            stable[stable_count] = j
            stable_count += 1
        else:
            unstable[unstable_count] = j
            unstable_count += 1
    return stable[:stable_count], unstable[:unstable_count], mass


@kernel
def _response_one(
    roots: Floats,
    rests: Floats,
    weight2: Floats,
    omega: Floats,
    omega_rest: Floats,
    uncertainty: float,
    roundings: float,
    response: Floats,
    condition: Floats,
) -> None:
    stable, unstable, rigid = _sorted(roots, weight2)
    root, stable_weight2, growth_weight2 = roots[stable], weight2[stable], weight2[unstable]
    growth = -roots[unstable]
    over_root = stable_weight2 / root
    total, size, slope = np.empty(_LANES), np.empty(_LANES), np.empty(_LANES)
    q, q_rest = np.empty(_LANES), np.empty(_LANES)
    w, w_rest = np.empty(_LANES), np.empty(_LANES)
    largest = np.max(root) if root.size else 0.0
    root_rest = root * rests[stable]
    # Relative errors of the eigenvalues, in roundings.
    relative_error = 0.5 * (roundings - 2.0) + uncertainty / (2.0 * _EPS * root * root)
    weight2_error, over_root_error = (
        stable_weight2 * (1.0 + relative_error),
        over_root * relative_error,
    )
    still = np.sum(weight2_error) + roundings * rigid
    large_over = over_root * roundings
    unstable_error = 0.5 * (roundings - 2.0) + uncertainty / (2.0 * _EPS * growth * growth)
    for first in range(0, omega.size, _LANES):
        count = min(_LANES, omega.size - first)
        # Slices: no index into them can be negative, which loops over vectors must know.
        some, some_rest = omega[first : first + count], omega_rest[first : first + count]
        for lane in range(count):
            w[lane], w_rest[lane] = some[lane], some_rest[lane]
        for lane in range(count, _LANES):
            w[lane], w_rest[lane] = w[0], w_rest[0]
        for lane in range(_LANES):
            q[lane] = 1.0 / w[lane]
            q_rest[lane] = q[lane] * (fma(-q[lane], w[lane], 1.0) - w_rest[lane])
        _sum_stable(
            root,
            root_rest,
            over_root,
            large_over,
            over_root_error,
            weight2_error,
            q,
            q_rest,
            total,
            size,
            slope,
        )
        for lane in range(_LANES):
            # What relative changes of weights and natural frequencies change: a^2 |T| and,
            # as the derivative of gamma T is 1/cos^2, a^2 (|T| + 1/cos^2); what changes of
            # eigenvalues change: a^2 (1/cos^2 - T)/(2 lambda), which is 1/3 of a^2/omega^2 for
            # rigid-body modes.
            spread = fma(size[lane], w[lane], still + slope[lane])
            size[lane] = spread + rigid * uncertainty * q[lane] * q[lane] / (3.0 * _EPS)
            total[lane] = fma(total[lane], w[lane], rigid)
        for j in range(growth.size):
            for lane in range(_LANES):
                g = growth[j] * q[lane]
                term = growth_weight2[j] * math.tanh(g) / g
                total[lane] += term
                size[lane] += roundings * term
                steep = growth_weight2[j] / math.cosh(min(g, 300.0)) ** 2
                size[lane] += steep + (term - steep) * unstable_error[j]
        S, magnified = response[first : first + count], condition[first : first + count]
        for lane in range(count):
            known = (largest * q[lane] < LARGEST) & (total[lane] != 0.0)
            S[lane] = total[lane] if known else np.inf
            magnified[lane] = size[lane] / abs(total[lane]) if known else np.inf


@kernel
def _sum_stable(
    root: Floats,
    root_rest: Floats,
    over_root: Floats,
    large_over: Floats,
    over_root_error: Floats,
    weight2_error: Floats,
    q: Floats,
    q_rest: Floats,
    total: Floats,
    size: Floats,
    slope: Floats,
) -> None:
    """Sum over the stable modes ``a^2 tan/root`` and what makes up its error.

    `size` receives ``sum (r |a^2 tan| - d a^2 tan)/root`` and `slope` ``sum a^2 (1 + d) tan^2``
    with the relative errors d of the eigenvalues and r of the weights, in roundings.
    """
    some = np.empty(_LANES)
    for lane in range(_LANES):
        total[lane] = 0.0
        size[lane] = 0.0
        slope[lane] = 0.0
    for first in range(0, root.size, _MODES):
        for lane in range(_LANES):
            some[lane] = 0.0
        for j in range(first, min(first + _MODES, root.size)):
            r, e, a = root[j], root_rest[j], over_root[j]
            large, less, b = large_over[j], over_root_error[j], weight2_error[j]
            for lane in range(_LANES):
                x = r * q[lane]
                rest = fma(e, q[lane], fma(r, q_rest[lane], fma(r, q[lane], -x)))
                t = tangent(x, rest)
                some[lane] = fma(a, t, some[lane])
                size[lane] = fma(large, abs(t), fma(-less, t, size[lane]))
                slope[lane] = fma(b * t, t, slope[lane])
        for lane in range(_LANES):
            total[lane] += some[lane]
