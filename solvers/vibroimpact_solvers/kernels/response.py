"""Impulses and amplitudes of the impact modes with one constraint at many frequencies.

With ``q = 1/omega`` and the signed natural frequencies r of the modes, eq. 10.53 divides the gap
by the response, omega^2 times the receptance of the triangle wave:

    S = sum_j a_j^2 T(mu_j) = omega sum_j (a_j^2 / r_j) tan(r_j q),     p = gap omega^2 / S

It is summed for a block of frequencies at a time, one frequency in each lane of the vector unit.
Near a pole of a mode its term outgrows the others and p goes through zero with it: finite, as no
floating-point phase is a pole. Phases are sums of two doubles, so that close to its poles p is as
accurate as the data are.

The error has three causes. With relative errors d of an eigenvalue's root and an error of a squared
weight, a term of a stable mode changes by at most

    a^2 d [1 + tan^2 - tan/gamma] + |d(a^2)| |tan|/gamma ,

as the derivative of ``gamma tan(gamma)/gamma`` by the frequency is ``1/cos^2``; rounding changes
it by a few units of its last place, and the sum of n terms, 32 of which are summed at a time, by
``(32 + n/32) u`` of the sum of their magnitudes. The sum over all modes, over ``EPS |S|``, is the
condition.

The amplitudes ``D = a gap/(S cos)`` have the error of S in common; apart from it they err by
``gap/(|S cos|) [|da| + |a| (d gamma |tan| + 8 u)]``.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.jit import fma, inner, kernel, sums
from vibroimpact_solvers.kernels.phases import LARGEST, sine_cosine, tangent
from vibroimpact_solvers.kernels.threads import over_ranges

_EPS = 2.220446049250313e-16
_UNIT = 0.5 * _EPS
_ROUNDED = 8.0 * _UNIT  # of an amplitude and its phase
_LANES = 64  # frequencies of a block
_PHASES = 512  # cosines of a block
_MODES = 32  # terms that are summed before their sum joins the total, against rounding


def impulses_of(S: Floats, omega: Floats, gap: float) -> Floats:
    """Return the impulses that bring a response of `response_one` to a gap, shape (frequency,)."""
    with np.errstate(over="ignore", invalid="ignore"):
        p = gap * omega * omega / S
    return np.where(np.isfinite(S), p, 0.0)


class Participations(NamedTuple):
    """One row of the modal matrix, and the errors of the modes, each (mode,)."""

    row: Floats  # ``w^T e_j``
    row_error: Floats
    root_error: Floats  # relative to the natural frequencies
    angle: Floats  # of the modes, in the norm of M


class Sizes(NamedTuple):
    """Sizes and errors of motions for a unit of gap over response, each (frequency,).

    Displacements are bounded in the norm of M at all times, and energies over ``omega^2``.
    """

    motion: Floats  # norm of all displacements
    motion_error: Floats  # of the displacements, beside that of the response
    energy: Floats  # twice the energy
    energy_error: Floats  # of the energy, beside that of the response


def amplitudes_one(
    roots: Floats,
    rests: Floats,
    modes: Participations,
    omega: Floats,
    omega_rests: Floats,
    scale: Floats,
) -> tuple[Floats, Sizes]:
    """Return amplitudes of the motion that impulses at one coordinate cause, and their errors.

    A solution of the family is ``q = D sin(gamma tau)/gamma``, eq. 10.48, with
    ``D = a gap/(S cos(gamma))``. Near a pole S grows as its mode's ``1/cos(gamma)`` does, and
    as both are functions of the same phase D is as accurate there as anywhere.

    Parameters
    ----------
    roots, rests, omega, omega_rests
        As of `response_one`.
    modes : Participations
    scale : array, shape (set, frequency)
        Gaps over the response; where it is 0 nothing moves.

    Returns
    -------
    D : array, shape (set, frequency, mode)
        Of unstable modes, the D of ``D sinh(g tau)/(g cosh(g))``.
    sizes : Sizes
    """
    D = np.empty((scale.shape[0], omega.size, roots.size))
    count = omega.size
    sizes = Sizes(np.empty(count), np.empty(count), np.empty(count), np.empty(count))

    def piece(start: int, stop: int) -> None:
        _amplitudes_one(roots, rests, modes, omega, omega_rests, scale, D, sizes, (start, stop))

    over_ranges(piece, omega.size, 4.0 * D.size)
    return D, sizes


@kernel
def _amplitudes_one(
    roots: Floats,
    rests: Floats,
    shapes: Participations,
    omega: Floats,
    omega_rests: Floats,
    scale: Floats,
    D: Floats,
    sizes: Sizes,
    some_frequencies: tuple[int, int],
) -> None:
    modes, (start, stop) = roots.size, some_frequencies
    step = max(1, _PHASES // max(modes, 1))
    phase, rest = np.empty(step * modes), np.empty(step * modes)
    root, root_rest = np.empty(modes), np.empty(modes)
    inverse = np.empty(modes)
    for j in range(modes):
        # The amplitude of an unstable mode is that of one at rest.
        root[j] = max(roots[j], 0.0)
        root_rest[j] = root[j] * rests[j]
        inverse[j] = 1.0 / max(root[j], 1e-200)
    for first in range(start, stop, step):
        count = min(step, stop - first)
        for f in range(count):
            some, some_rest = phase[f * modes : (f + 1) * modes], rest[f * modes : (f + 1) * modes]
            q = 1.0 / omega[first + f]
            q_rest = q * (fma(-q, omega[first + f], 1.0) - omega_rests[first + f])
            for j in range(modes):
                x = root[j] * q
                lost = fma(root[j], q_rest, fma(root[j], q, -x))
                some[j], some_rest[j] = x, fma(root_rest[j], q, lost)
        _secants(phase[: count * modes], rest[: count * modes])
        for f in range(count):
            secant = phase[f * modes : (f + 1) * modes]
            _measure(shapes, root, inverse, secant, omega[first + f], sizes, first + f)
        for s in range(scale.shape[0]):
            for f in range(count):
                secant, factor = phase[f * modes : (f + 1) * modes], scale[s, first + f]
                amplitude = D[s, first + f]
                if factor == 0.0:
                    # Nothing moves where the response is infinite; its secant may be.
                    for j in range(modes):
                        amplitude[j] = 0.0
                else:
                    for j in range(modes):
                        amplitude[j] = shapes.row[j] * factor * secant[j]


@sums
def _measure(
    modes: Participations,
    root: Floats,
    inverse: Floats,
    secant: Floats,
    omega: float,
    sizes: Sizes,
    f: int,
) -> None:
    """Fill in sizes and errors of the motion at one frequency; `inverse` are 1/root."""
    row, row_error, root_error, angle = modes
    q, n = 1.0 / omega, row.size
    motion, error, energy, energy_error = 0.0, 0.0, 0.0, 0.0
    for j in range(n):
        s = abs(secant[j])
        # Amplitudes D/gamma of displacements; those of soft modes are D at most.
        least = min(1.0, omega * inverse[j])
        size = abs(row[j]) * s
        own = s * fma(size, root_error[j] * fma(root[j], q, 1.0), row_error[j])
        blur = fma(_ROUNDED, size, own * least)
        energy += size * size
        energy_error += size * fma(_ROUNDED, size, own)
        size *= least
        turned = size * angle[j]
        motion += size * size
        # The norms of what errors of modes cause add up: n squares are more than their square.
        error += fma(turned, n * turned, blur * blur)
    sizes.motion[f] = math.sqrt(motion)
    sizes.motion_error[f] = 1.5 * math.sqrt(error) + (n + 4) * _UNIT * sizes.motion[f]
    sizes.energy[f], sizes.energy_error[f] = energy, energy_error


@inner
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
    errors: Floats | None = None,
    weight2_errors: Floats | None = None,
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
    errors : array, shape (mode,), optional
        Errors of the eigenvalues, beside `rests`.
    weight2_errors : array, shape (mode,), optional
        Errors of the squares.

    Returns
    -------
    S, condition : array, shape (frequency,)
        ``omega^2`` times the response, and by how much relative errors of the natural
        frequencies and weights are magnified in it. Both are infinite where the response
        vanishes, so that no impulse reaches the wall, or the phases of the modes are unknown.
    """
    S, condition = np.empty((2, omega.size))
    weights = Weights(
        weight2,
        _EPS * weight2 if weight2_errors is None else weight2_errors,
        np.zeros(roots.size) if errors is None else errors,
    )

    def piece(start: int, stop: int) -> None:
        some = slice(start, stop)
        _response_one(
            roots, rests, weights, omega[some], omega_rests[some], S[some], condition[some]
        )

    over_ranges(piece, omega.size, float(roots.size) * omega.size)
    return S, condition


class Weights(NamedTuple):
    """Squared weights of the modes, their errors, and those of the eigenvalues, each (mode,)."""

    weight2: Floats
    weight2_error: Floats
    eigenvalue_error: Floats


class _Stable(NamedTuple):
    """Coefficients of the stable modes, each (mode,); the errors are in roundings."""

    root: Floats  # natural frequencies
    root_rest: Floats  # what rounding took from them
    over_root: Floats  # squared weights over the natural frequencies
    over_root_error: Floats  # times the relative errors of the weights
    over_root_change: Floats  # times those of the eigenvalues
    weight2_error: Floats  # squared weights times those of both


class _Unstable(NamedTuple):
    """Coefficients of the unstable modes, each (mode,)."""

    growth: Floats  # growth rates
    weight2: Floats  # squared weights
    noise: Floats  # their errors, roundings included, in roundings
    error: Floats  # relative errors of the growth rates, in roundings


class _Lanes(NamedTuple):
    """A block of frequencies and what is summed for them, each (lane,)."""

    q: Floats  # 1/omega
    q_rest: Floats  # what rounding took from it
    total: Floats  # S, first over omega
    size: Floats  # its error, in roundings, first over omega
    slope: Floats  # the part of it with squared tangents


@inner
def _is_rigid(root: float, weight2: float) -> bool:
    """Whether a mode is so soft that its tangent is its argument at any frequency."""
    return not math.isfinite(weight2 / abs(root))


@inner
def _coefficients(
    roots: Floats, rests: Floats, weights: Weights, stable: _Stable, unstable: _Unstable
) -> tuple[float, float, float]:
    """Fill in coefficients; return the weight of rigid-body modes, and two constant errors.

    The second is that of the rigid-body modes' eigenvalues, over ``omega^2``.
    """
    swings, grows, rigid, still, soft = 0, 0, 0.0, 0.0, 0.0
    # The terms, and sums of 32 of them and of these sums.
    rounded = 3.0 + 0.5 * (min(roots.size, _MODES) + roots.size / _MODES)
    for j in range(roots.size):
        root, square = abs(roots[j]), weights.weight2[j]
        noise = rounded * square + weights.weight2_error[j] / _EPS
        change = weights.eigenvalue_error[j] / (2.0 * _EPS)
        if _is_rigid(root, square):
            rigid += square
            still += noise
            soft += 2.0 * square * change
            continue
        # Phases are known to the square of a rounding.
        error = change / (root * root) + 4.0 * _EPS
        if roots[j] > 0.0:
            stable.root[swings], stable.root_rest[swings] = root, root * rests[j]
            stable.over_root[swings] = square / root
            stable.over_root_error[swings] = noise / root
            stable.over_root_change[swings] = square / root * error
            stable.weight2_error[swings] = square * error
            still += square * error
            swings += 1
        else:
            unstable.growth[grows], unstable.weight2[grows] = root, square
            unstable.noise[grows], unstable.error[grows] = noise, error
            grows += 1
    return rigid, still, soft


@kernel
def _response_one(
    roots: Floats,
    rests: Floats,
    weights: Weights,
    omega: Floats,
    omega_rests: Floats,
    response: Floats,
    condition: Floats,
) -> None:
    swings, grows, largest = 0, 0, 0.0
    for j in range(roots.size):
        if not _is_rigid(roots[j], weights.weight2[j]):
            swings += roots[j] > 0.0
            grows += roots[j] < 0.0
            largest = max(largest, roots[j])
    stable = _Stable(
        np.empty(swings), np.empty(swings), np.empty(swings), np.empty(swings), np.empty(swings),
        np.empty(swings),
    )  # fmt: skip
    unstable = _Unstable(np.empty(grows), np.empty(grows), np.empty(grows), np.empty(grows))
    lanes = _Lanes(
        np.empty(_LANES), np.empty(_LANES), np.empty(_LANES), np.empty(_LANES), np.empty(_LANES)
    )
    rigid, still, soft = _coefficients(roots, rests, weights, stable, unstable)
    some, w = np.empty(_LANES), np.empty(_LANES)
    q, q_rest, total, size, slope = lanes
    for first in range(0, omega.size, _LANES):
        count = min(_LANES, omega.size - first)
        for lane in range(_LANES):
            f = first + min(lane, count - 1)
            w[lane], q[lane] = omega[f], 1.0 / omega[f]
            q_rest[lane] = q[lane] * (fma(-q[lane], w[lane], 1.0) - omega_rests[f])
        _sum_stable(stable, lanes, some)
        for lane in range(_LANES):
            # What changes of weights change: |T|; what changes of eigenvalues change:
            # a^2 (1/cos^2 - T)/(2 lambda), which is 1/3 of a^2/omega^2 for rigid-body modes.
            spread = fma(size[lane], w[lane], still + slope[lane])
            size[lane] = spread + soft * q[lane] * q[lane] / 3.0
            total[lane] = fma(total[lane], w[lane], rigid)
        for j in range(grows):
            for lane in range(_LANES):
                g = unstable.growth[j] * q[lane]
                ratio = math.tanh(g) / g
                term = unstable.weight2[j] * ratio
                steep = unstable.weight2[j] / math.cosh(min(g, 300.0)) ** 2
                total[lane] += term
                size[lane] += unstable.noise[j] * ratio + (term - steep) * unstable.error[j] + steep
        # Slices: no index into them can be negative, which loops over vectors must know.
        S, magnified = response[first : first + count], condition[first : first + count]
        for lane in range(count):
            known = (largest * q[lane] < LARGEST) & (total[lane] != 0.0)
            S[lane] = total[lane] if known else np.inf
            magnified[lane] = size[lane] / abs(total[lane]) if known else np.inf


@inner
def _sum_stable(stable: _Stable, lanes: _Lanes, some: Floats) -> None:
    """Sum over the stable modes ``a^2 tan/root`` and what makes up its error.

    `size` receives ``sum (e |a^2 tan| - d a^2 tan)/root`` and `slope` ``sum a^2 (1 + d) tan^2``
    with the relative errors d of the eigenvalues and e of the weights, in roundings; `some`,
    (lane,), is room for sums of a few terms.
    """
    q, q_rest, total, size, slope = lanes
    for lane in range(_LANES):
        total[lane], size[lane], slope[lane] = 0.0, 0.0, 0.0
    for first in range(0, stable.root.size, _MODES):
        for lane in range(_LANES):
            some[lane] = 0.0
        for j in range(first, min(first + _MODES, stable.root.size)):
            r, e, a = stable.root[j], stable.root_rest[j], stable.over_root[j]
            large, less = stable.over_root_error[j], stable.over_root_change[j]
            b = stable.weight2_error[j]
            for lane in range(_LANES):
                x = r * q[lane]
                rest = fma(e, q[lane], fma(r, q_rest[lane], fma(r, q[lane], -x)))
                t = tangent(x, rest)
                some[lane] = fma(a, t, some[lane])
                size[lane] = fma(large, abs(t), fma(-less, t, size[lane]))
                slope[lane] = fma(b * t, t, slope[lane])
        for lane in range(_LANES):
            total[lane] += some[lane]
