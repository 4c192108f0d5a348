"""Existence bands of a family with one constraint, proved by branch and bound.

With ``q = 1/omega`` the solution keeps within a limit if

    P(q, tau) = sum_j [alpha_j sin(theta_j) - beta_j sin(theta_j tau)] / (Omega_j cos(theta_j))

with ``theta_j = Omega_j q`` is positive for all tau in [-1, 1]. A rigid-body mode adds
``(alpha_j - beta_j tau) q``. Here ``beta_j`` is the product of the modal rows of the limited and
of the struck coordinate and ``alpha_j`` the square of that of the struck one, times the ratio of
the gaps. The impulse is out of it: its sign is that of ``P(q, -1)`` of the struck coordinate,
which increases with q between its poles, because tan(x)/x increases with x.

A range of q, the cell, is decided by boxes of q and tau. Over a box the sum is bounded from its
value and slopes at the centre and bounds of its second derivatives. A mode near its pole is
bounded by its bracket and its denominator apart, since the bracket, not the quotient, is smooth
there. All bounds leave room for rounding.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.jit import kernel
from vibroimpact_solvers.kernels.phases import sine_cosine

UNDECIDED: Final = 0
ADMISSIBLE: Final = 1
PHANTOM: Final = 2

_EPS = 2.220446049250313e-16
_NEAR = 0.3  # below this cosine a mode is bounded by its bracket
_FIRST_CELL = 0.25  # its phase in the fastest mode
_FIRST_BOX = 0.7
_BOXES = 2**17  # boxes that may wait
_SEGMENTS = 2**16  # segments of one sign band

# Rows that `_prepare` fills in for every mode: of its phase theta at the centre of a cell,
_SINE, _COSINE = 0, 1
# the smallest and largest cosine over the cell,
_SMALLEST, _LARGEST = 2, 3
# and, for every box, of theta tau.
_AT_SINE, _AT_COSINE = 4, 5
_ROWS = 6
# Rows that it fills in for every limit and mode far from its poles: coefficients of
# sin(theta tau) in P, of cos(theta tau) in its slope by tau, of sin(theta tau) in that by q;
_IN_VALUE, _IN_SLOPE, _IN_DRIFT = 0, 1, 2
# and for every limit: what does not depend on tau in P and in its slope by q, bounds of the
# second derivatives by q, q and tau, and tau, and the uncertainty by rounding.
_VALUE, _DRIFT, _BEND_Q, _BEND_MIXED, _BEND_TAU, _ROUNDING = 0, 1, 2, 3, 4, 5


class _Scratch(NamedTuple):
    """Memory that all cells of a survey share, see `_prepare`."""

    cell: Floats
    far: Floats
    sums: Floats
    near: Integers


@kernel
def sign_change(root: Floats, weight2: Floats, rigid: float, left: float, right: float) -> float:
    """Return where the response vanishes between two neighbouring poles left and right.

    It rises there from minus to plus infinity. The result is the last number at which it is
    not positive.
    """
    low, high = left, right
    while True:
        middle = 0.5 * (low + high)
        if not low < middle < high:
            return low
        total = rigid * middle
        for j in range(root.size):
            total += weight2[j] / root[j] * math.tan(root[j] * middle)
        if total > 0.0:
            high = middle
        else:
            low = middle


@kernel
def _prepare(
    root: Floats,
    alpha: Floats,
    beta: Floats,
    rigid_alpha: Floats,
    rigid_beta: Floats,
    q: float,
    half: float,
    cell: Floats,
    far: Floats,
    sums: Floats,
    near: Integers,
) -> int:
    """Fill in terms common to all boxes of a cell ``q +- half``; return how many modes are near.

    Parameters
    ----------
    cell : array, shape (6, mode)
    far : array, shape (limit, 3, mode)
    sums : array, shape (limit, 6)
    near : array of int, shape (mode,)
        Receives the modes near their poles.
    """
    count, last = 0, q + half
    for a in range(alpha.shape[0]):
        sums[a, _VALUE] = rigid_alpha[a] * q
        sums[a, _DRIFT] = rigid_alpha[a]
        sums[a, _BEND_Q] = 0.0
        sums[a, _BEND_MIXED] = abs(rigid_beta[a])
        sums[a, _BEND_TAU] = 0.0
        sums[a, _ROUNDING] = 4.0 * _EPS * (abs(rigid_alpha[a]) + abs(rigid_beta[a])) * q
    for j in range(root.size):
        r = root[j]
        phase = r * q
        sine, cosine = math.sin(phase), math.cos(phase)
        reach = r * half + 4.0 * _EPS * (1.0 + phase)
        smallest = max(abs(cosine) - reach, 0.0)
        cell[_SINE, j], cell[_COSINE, j] = sine, cosine
        cell[_SMALLEST, j], cell[_LARGEST, j] = smallest, min(abs(cosine) + reach, 1.0)
        away = smallest > 0.5 * abs(cosine)
        is_far = away and abs(cosine) >= _NEAR
        if not is_far:
            near[count] = j
            count += 1
        for a in range(alpha.shape[0]):
            b, size = abs(beta[a, j]), abs(alpha[a, j]) + abs(beta[a, j])
            far[a, _IN_VALUE, j] = 0.0
            far[a, _IN_SLOPE, j] = 0.0
            far[a, _IN_DRIFT, j] = 0.0
            if away:
                bound = 1.0 / smallest
                sums[a, _BEND_MIXED] += b * bound * (1.0 + r * last * (1.0 + bound))
                sums[a, _BEND_TAU] += b * r * last * last * bound
            if is_far:
                secant = 1.0 / cosine
                far[a, _IN_VALUE, j] = beta[a, j] * secant / r
                far[a, _IN_SLOPE, j] = beta[a, j] * secant
                far[a, _IN_DRIFT, j] = beta[a, j] * sine * secant * secant
                sums[a, _VALUE] += alpha[a, j] * sine * secant / r
                sums[a, _DRIFT] += alpha[a, j] * secant * secant
                sums[a, _BEND_Q] += r * bound * (b + 2.0 * bound * (b + bound * size))
                sums[a, _ROUNDING] += 4.0 * _EPS * size * (1.0 + phase) * abs(secant) / r
    return count


@kernel
def _clear(root: Floats, beta: Floats, rigid: float, q: float, half: float, cell: Floats) -> float:
    """Return for how long before an impact the struck coordinate keeps within its limits.

    With d = 1 - tau every mode adds ``beta [tan(theta) (1 - cos(theta d)) + sin(theta d)]/Omega``,
    of which only a negative tangent and the cubic term of the sine can be negative.
    """
    first = (np.sum(beta) + rigid) * (q - half)
    second, third = 0.0, 0.0
    for j in range(root.size):
        phase = root[j] * (q + half)
        third += beta[j] * phase * phase * (q + half) / 6.0
        if cell[_SINE, j] * cell[_COSINE, j] < 0.0:
            if cell[_SMALLEST, j] == 0.0:
                return 0.0
            second += 0.5 * beta[j] * phase * (q + half) / cell[_SMALLEST, j]
    if third == 0.0 and second == 0.0:
        return 2.0
    return min(2.0 * first / (second + math.sqrt(second * second + 4.0 * first * third)), 2.0)


@kernel
def _box(
    root: Floats,
    alpha: Floats,
    beta: Floats,
    rigid_beta: float,
    q: float,
    half: float,
    tau: float,
    width: float,
    cell: Floats,
    far: Floats,
    sums: Floats,
    near: Integers,
) -> tuple[float, float, float, float, float]:
    """Bounds of P over a box ``q +- half``, ``tau +- width``; of one limit.

    Returns
    -------
    value : float
        At the centre.
    low, high : float
        Bounds over the cell at this tau.
    least : float
        Lower bound over the box.
    rounding : float
        Uncertainty of the value.
    """
    in_value, in_slope, in_drift = 0.0, 0.0, 0.0
    for j in range(root.size):
        S, C = sine_cosine(root[j] * q * tau, 0.0)
        cell[_AT_SINE, j], cell[_AT_COSINE, j] = S, C
    for j in range(root.size):
        S, C = cell[_AT_SINE, j], cell[_AT_COSINE, j]
        in_value += far[_IN_VALUE, j] * S
        in_slope += far[_IN_SLOPE, j] * C
        in_drift += far[_IN_DRIFT, j] * S
    value = sums[_VALUE] - in_value - rigid_beta * tau * q
    slope_q = sums[_DRIFT] - in_drift - tau * (in_slope + rigid_beta)
    slope_tau = -q * (in_slope + rigid_beta)
    near_low, near_high, near_least, rounding = 0.0, 0.0, 0.0, sums[_ROUNDING]
    last = q + half
    for j in near:
        r, a, b = root[j], alpha[j], beta[j]
        sine, cosine = cell[_SINE, j], cell[_COSINE, j]
        smallest, largest = cell[_SMALLEST, j], cell[_LARGEST, j]
        phase = r * q
        S, C = cell[_AT_SINE, j], cell[_AT_COSINE, j]
        size = abs(a) + abs(b)
        noise = 4.0 * _EPS * size * (1.0 + phase)
        bracket = (a * sine - b * S) * (1.0 if cosine > 0.0 else -1.0)
        drift = r * half * abs(a * cosine - b * tau * C) + noise
        drift += 0.5 * r * r * half * half * size
        low = _over(bracket - drift, r * smallest, r * largest)
        high = -_over(-bracket - drift, r * smallest, r * largest)
        least = low
        if smallest > 0.5 * abs(cosine):
            slope_tau -= b * q * C / cosine
        else:
            sway = width * (abs(b) * (phase * abs(C) + r * half * (1.0 + r * last)))
            sway += 0.5 * abs(b) * (r * last * width) ** 2
            least = _over(bracket - drift - sway, r * smallest, r * largest)
        # The bracket is never smaller than minus, or larger than plus, the squared cosine.
        floor = abs(b) * largest / r
        if a >= abs(b) and sine * cosine > 0.0:
            low, least = max(low, -floor), max(least, -floor)
        elif a >= abs(b):
            high = min(high, floor)
        value += bracket / (r * max(abs(cosine), _EPS))
        rounding += noise / (r * max(abs(cosine), _EPS))
        near_low += low
        near_high += high
        near_least += least
    far_sum = sums[_VALUE] - in_value - rigid_beta * tau * q
    spread = half * (abs(slope_q) + 0.5 * half * sums[_BEND_Q]) + sums[_ROUNDING]
    across = width * (abs(slope_tau) + half * sums[_BEND_MIXED] + 0.5 * width * sums[_BEND_TAU])
    return (
        value,
        far_sum - spread + near_low,
        far_sum + spread + near_high,
        far_sum - spread - across + near_least,
        rounding,
    )


@kernel
def _over(bracket: float, smallest: float, largest: float) -> float:
    """Lower bound of ``bracket / d`` for d between smallest and largest."""
    if bracket >= 0.0:
        return bracket / largest
    return bracket / smallest if smallest > 0.0 else -np.inf


@kernel
def survey(
    root: Floats,
    alpha: Floats,
    beta: Floats,
    rigid_alpha: Floats,
    rigid_beta: Floats,
    struck: int,
    start: float,
    stop: float,
    resolution: float,
    budget: int,
) -> tuple[Floats, Integers, Floats, Integers, int]:
    """Decide where in a range of q, in which the impulse is positive, solutions are admissible.

    Parameters
    ----------
    root : array, shape (mode,)
        Natural frequencies of the modes that take part in the struck coordinate, positive.
    alpha, beta : array, shape (limit, mode)
        See above.
    rigid_alpha, rigid_beta : array, shape (limit,)
        Their sums over rigid-body modes.
    struck : int
        Which limit is the struck one.
    start, stop : float
        The range; no pole lies inside.
    resolution : float
        Cells that are narrower, relative to q, are not divided again.
    budget : int
        Boxes that may be evaluated before the rest is left undecided.

    Returns
    -------
    bounds : array, shape (segment + 1,)
        Where the segments meet.
    status : array, shape (segment,)
        `ADMISSIBLE`, `PHANTOM` or `UNDECIDED`.
    witness : array, shape (segment,)
        A tau at which a limit is passed somewhere in a phantom segment.
    limit : array, shape (segment,)
        Which limit that is.
    spent : int
        Boxes evaluated.
    """
    ends, status = np.empty(_SEGMENTS), np.empty(_SEGMENTS, np.int64)
    witness, passed = np.empty(_SEGMENTS), np.empty(_SEGMENTS, np.int64)
    count, spent = 0, 0
    waiting = np.empty((_BOXES, 2))
    whose = np.empty(_BOXES, np.int64)
    scratch = _Scratch(
        np.empty((_ROWS, root.size)),
        np.empty((alpha.shape[0], 3, root.size)),
        np.empty((alpha.shape[0], 6)),
        np.empty(root.size, np.int64),
    )
    cells, marks = np.empty((256, 2)), np.empty((256, 2), np.int64)
    fastest = np.max(root) if root.size else 0.0
    parts = max(1, math.ceil((stop - start) * fastest / _FIRST_CELL))
    hint, hinted = 0.0, struck
    for part in range(parts):
        left = start + (stop - start) * part / parts
        right = start + (stop - start) * (part + 1) / parts if part + 1 < parts else stop
        kept = 0
        boxes = max(4, math.ceil(2.0 * fastest * right / _FIRST_BOX))
        # Where they would be too many, wider ones: those that matter are divided later.
        boxes = min(boxes, _BOXES // (2 * alpha.shape[0]))
        for a in range(alpha.shape[0]):
            for k in range(boxes):
                waiting[kept, 0] = -1.0 + 2.0 * k / boxes
                waiting[kept, 1] = -1.0 + 2.0 * (k + 1) / boxes
                whose[kept] = a
                kept += 1
        cells[0, 0], cells[0, 1] = left, right
        marks[0, 0], marks[0, 1] = 0, kept
        depth = 1
        while depth > 0:
            depth -= 1
            left, right = cells[depth, 0], cells[depth, 1]
            verdict, hint, hinted, top, examined, settled = _decide(
                root,
                alpha,
                beta,
                rigid_alpha,
                rigid_beta,
                struck,
                left,
                right,
                hint,
                hinted,
                waiting,
                whose,
                marks[depth, 0],
                marks[depth, 1],
                scratch,
            )
            spent += examined
            middle = 0.5 * (left + right)
            narrow = right - left <= resolution * right or not left < middle < right
            if verdict == UNDECIDED and not (narrow or settled or spent > budget or depth > 250):
                bottom = marks[depth, 1]
                cells[depth, 0], cells[depth, 1] = middle, right
                marks[depth, 0], marks[depth, 1] = bottom, top
                depth += 1
                cells[depth, 0], cells[depth, 1] = left, middle
                marks[depth, 0], marks[depth, 1] = bottom, top
                depth += 1
                continue
            if count > 0 and (status[count - 1] == verdict or count == _SEGMENTS - 1):
                if status[count - 1] != verdict:
                    status[count - 1] = UNDECIDED
                ends[count - 1] = right
                continue
            ends[count], status[count] = right, verdict
            witness[count], passed[count] = hint, hinted
            count += 1
    bounds = np.empty(count + 1)
    bounds[0] = start
    bounds[1:] = ends[:count]
    return bounds, status[:count], witness[:count], passed[:count], spent


@kernel
def _decide(
    root: Floats,
    alpha: Floats,
    beta: Floats,
    rigid_alpha: Floats,
    rigid_beta: Floats,
    struck: int,
    left: float,
    right: float,
    hint: float,
    hinted: int,
    waiting: Floats,
    whose: Integers,
    bottom: int,
    top: int,
    scratch: _Scratch,
) -> tuple[int, float, int, int, int, bool]:
    """Decide one cell from its undecided boxes, numbers bottom to top.

    Returns
    -------
    verdict : int
    hint : float
        The tau at which P was smallest, in limit `hinted`.
    hinted : int
    top : int
        The boxes that remain undecided have the numbers from the old top to this one.
    looked : int
        Number of boxes evaluated.
    settled : bool
        Whether rounding, not the size of the cell, kept it undecided.
    """
    q, half = 0.5 * (left + right), 0.5 * (right - left)
    cell, far, sums = scratch.cell, scratch.far, scratch.sums
    count = _prepare(
        root, alpha, beta, rigid_alpha, rigid_beta, q, half, cell, far, sums, scratch.near
    )
    near = scratch.near[:count]
    _, _, high, _, _ = _box(
        root,
        alpha[hinted],
        beta[hinted],
        rigid_beta[hinted],
        q,
        half,
        hint,
        0.0,
        cell,
        far[hinted],
        sums[hinted],
        near,
    )
    if high < 0.0:
        return PHANTOM, hint, hinted, top, 1, False
    clear = 1.0 - _clear(root, beta[struck], rigid_beta[struck], q, half, cell)
    examined, end, smallest, settled = 1, top, np.inf, False
    best, whose_best = hint, hinted
    stack = np.empty((128, 2))
    for k in range(bottom, top):
        a = whose[k]
        stack[0, 0], stack[0, 1] = waiting[k, 0], waiting[k, 1]
        if a == struck:
            stack[0, 1] = min(stack[0, 1], clear)
        depth = 1 if stack[0, 0] < stack[0, 1] else 0
        while depth > 0:
            depth -= 1
            low_tau, high_tau = stack[depth, 0], stack[depth, 1]
            tau, width = 0.5 * (low_tau + high_tau), 0.5 * (high_tau - low_tau)
            value, low, high, least, rounding = _box(
                root,
                alpha[a],
                beta[a],
                rigid_beta[a],
                q,
                half,
                tau,
                width,
                cell,
                far[a],
                sums[a],
                near,
            )
            examined += 1
            if least > 0.0:
                continue
            if high < 0.0:
                return PHANTOM, tau, a, top, examined, False
            if value < smallest:
                smallest, best, whose_best = value, tau, a
            # Divided along tau as long as its width in tau is what keeps the box undecided; where
            # P is negative, only a narrower cell can decide it.
            wide = value > 0.0 and low - least > 0.25 * (value - low) and width > 1e-9
            if wide and depth < 126:
                stack[depth, 0], stack[depth, 1] = tau, high_tau
                stack[depth + 1, 0], stack[depth + 1, 1] = low_tau, tau
                depth += 2
                continue
            if value - low <= 4.0 * rounding and abs(value) <= 8.0 * rounding:
                settled = True
            if end < _BOXES:
                if end > top and whose[end - 1] == a and waiting[end - 1, 1] == low_tau:
                    waiting[end - 1, 1] = high_tau
                else:
                    waiting[end, 0], waiting[end, 1], whose[end] = low_tau, high_tau, a
                    end += 1
            else:
                settled = True
    if end == top:
        return ADMISSIBLE, best, whose_best, top, examined, False
    return UNDECIDED, best, whose_best, end, examined, settled
