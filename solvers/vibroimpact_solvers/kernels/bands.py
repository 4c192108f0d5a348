"""Existence bands of a family with one constraint, proved by branch and bound.

With ``q = 1/omega`` the solution of eq. 10.48 keeps within a limit if

    P(q, tau) = sum_j [alpha_j sin(theta_j) - beta_j sin(theta_j tau)] / (Omega_j cos(theta_j))

with ``theta_j = Omega_j q`` is positive for all tau in [-1, 1]. A rigid-body mode adds
``(alpha_j - beta_j tau) q``. Here ``beta_j`` is the product of the modal rows of the limited and
of the struck coordinate and ``alpha_j`` the square of that of the struck one, times the ratio of
the gaps. The impulse is out of it: its sign is that of ``P(q, -1)`` of the struck coordinate,
which increases with q between its poles, because tan(x)/x increases with x.

A range of q, the cell, is decided by boxes of q and tau. Over a box ``q0 +- half``,
``tau0 +- width`` the sum is bounded by Taylor's theorem from its value and slopes at the centre:

    |P - P0| <= half |P_q| + width |P_tau| + half^2/2 B_qq + half width B_qtau + width^2/2 B_tautau

with bounds B of its second derivatives over the box. A mode near its pole is bounded by its
bracket and its denominator apart, since the bracket, not the quotient, is smooth there. Modes that
turn within the box, ``Omega_j q width > 1``, are not expanded: the least that they can give at any
tau is enough where it is small beside the others, and if it is not, narrower boxes are.

All bounds are outward. Each phase ``r q``, with a root r known to within d, and its sine and cosine
are wrong by at most

    blur = 2 eps (1 + r q) + d q

(two roundings of the phase, one unit in the last place of the functions, and the root). With
``size = |alpha| + |beta|``, known to within `doubt`, a bracket is wrong by ``doubt + size blur``, a
quotient by the cosine by ``size blur/cos^2`` more, slopes by ``1/cos`` times as much; a sum of n
terms adds ``n eps`` times their magnitudes. What is computed from such bounds in doubles is raised
by `_UP`.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.jit import inline, inner, kernel
from vibroimpact_solvers.kernels.phases import sine_cosine

UNDECIDED: Final = 0
ADMISSIBLE: Final = 1
PHANTOM: Final = 2

_EPS = 2.220446049250313e-16
_UP = 1.0 + 1e-10  # more than the roundings of a bound
_NEAR = 0.3  # below this cosine a mode is bounded by its bracket
_FIRST_CELL = 0.25  # its phase in the fastest mode
_FIRST_BOX = 0.7  # its phase in the fastest mode
_FIRST_BOXES = 32  # at most: of more, most can be decided by a few modes
_NONE = 0  # the place of sums over no modes
_SLOW = 1.0  # phase in a box up to which a mode is expanded about its centre
_PATIENCE = 32  # boxes whose centre needs a narrower cell, until no others are looked at
_BOXES = 2**17  # boxes that may wait
_CELLS = 256  # cells that may wait
_STACK = 128  # parts of a box that may wait
_SEGMENTS = 2**16  # segments of one sign band


class Margin(NamedTuple):
    """The function P of every limit, see the module."""

    root: Floats  # natural frequencies Omega_j of the modes that take part, ascending, (mode,)
    root_error: Floats  # their absolute errors, (mode,)
    # Each (limit, mode); doubt is the error of ``|alpha| + |beta|``
    alpha: Floats
    beta: Floats
    doubt: Floats
    # Their sums over rigid-body modes, (limit,)
    rigid_alpha: Floats
    rigid_beta: Floats
    rigid_doubt: Floats
    silent: Floats  # what modes left out can change, times q, (limit,)
    struck: int  # which limit is the struck one


class Survey(NamedTuple):
    """A range of q in segments, each (segment,) but the bounds."""

    bounds: Floats  # where the segments meet, (segment + 1,)
    status: Integers  # `ADMISSIBLE`, `PHANTOM` or `UNDECIDED`
    witness: Floats  # a tau at which a limit is passed somewhere in a phantom segment
    limit: Integers  # which limit that is
    boxes: int  # boxes evaluated


class _Modes(NamedTuple):
    """Terms of the modes in a cell, each (mode,)."""

    # Of the phase theta at the centre of the cell
    sine: Floats
    cosine: Floats
    blur: Floats  # error of the phase, its sine and its cosine
    # The smallest and largest magnitude of the cosine over the cell
    smallest: Floats
    largest: Floats
    # Of theta tau, for every box
    at_sine: Floats
    at_cosine: Floats
    near: Integers  # those near their poles; the first `count` of a cell count


class _Far(NamedTuple):
    """Coefficients of modes far from their poles, 0 of the others, each (limit, mode)."""

    value: Floats  # of sin(theta tau) in P
    slope: Floats  # of cos(theta tau) in its slope by tau
    drift: Floats  # of sin(theta tau) in its slope by q


class _Sums(NamedTuple):
    """Sums over the slowest modes of a cell, of none to all of them, each (limit, mode + 1)."""

    # What does not depend on tau in P and in its slope by q, of modes far from their poles
    value: Floats
    drift: Floats
    # Bounds of the second derivatives by q, by q and tau, and by tau
    bend_q: Floats
    bend_mixed: Floats
    bend_tau: Floats
    # Uncertainty of the value, and of the slopes: by q, and by tau over q
    rounding: Floats
    tilt: Floats
    floor: Floats  # of the other, faster modes: the least that they give at any tau


class _Cell(NamedTuple):
    """A range of q, and the terms common to all its boxes."""

    margin: Margin
    modes: _Modes
    far: _Far
    sums: _Sums
    q: float  # its centre
    half: float  # half its width
    near: int  # number of modes near their poles


class _Boxes(NamedTuple):
    """Ranges of tau that wait for a decision, and of which limit, each (box,)."""

    low: Floats
    high: Floats
    limit: Integers


class _Bounds(NamedTuple):
    """Bounds of P over a box, of one limit or of one of its terms."""

    value: float  # at the centre
    # Over the cell at this tau
    low: float
    high: float
    least: float  # lower bound over the box
    rounding: float  # uncertainty of the value


class _Verdict(NamedTuple):
    """What is known of a cell."""

    status: int
    # Where P was smallest, and of which limit
    tau: float
    limit: int
    top: int  # the boxes that remain undecided have the numbers from the old top to this one
    boxes: int  # evaluated
    settled: bool  # whether rounding, not the size of the cell, kept it undecided


@inner
def _response(margin: Margin, q: float) -> tuple[float, float]:
    """Return the response of the struck coordinate and a bound of its error."""
    a, n = margin.struck, margin.root.size
    total, wrong = margin.rigid_beta[a] * q, margin.rigid_doubt[a] * q + margin.silent[a] / q
    size = abs(total)
    for j in range(n):
        r = margin.root[j]
        t, blur = math.tan(r * q), 2.0 * _EPS * (1.0 + r * q) + margin.root_error[j] * q
        beta = margin.beta[a, j]
        total += beta * t / r
        size += abs(beta * t) / r
        wrong += (margin.doubt[a, j] * abs(t) + 2.0 * beta * blur * (1.0 + t * t)) / r
        if not blur * abs(t) < 0.25:
            wrong = np.inf
    return total, (wrong + (n + 4) * _EPS * size) * _UP


@kernel
def sign_change(margin: Margin, left: float, right: float) -> tuple[float, float]:
    """Return where the response vanishes between two neighbouring poles, and the error of that.

    It rises there from minus to plus infinity. The error encloses the zero: to both sides of it
    the sign of the response is proved, unless a pole is closer.
    """
    low, high = left, right
    middle = 0.5 * (low + high)
    while low < middle < high:
        value, wrong = _response(margin, middle)
        if value > 0.0:
            high = middle
        else:
            low = middle
        middle = 0.5 * (low + high)
    error = 0.0
    for side in (-1.0, 1.0):
        step, known = _EPS * low, False
        while not known:
            place = min(max(low + side * step, left), right)
            value, wrong = _response(margin, place)
            known = side * value > wrong or not left < place < right
            error = max(error, abs(place - low))
            step *= 2.0
    return low, error


@inner
def _prepare(margin: Margin, modes: _Modes, far: _Far, sums: _Sums, q: float, half: float) -> int:
    """Fill in terms common to all boxes of a cell ``q +- half``; return how many modes are near."""
    count, last, n = 0, q + half, margin.root.size
    limits = margin.alpha.shape[0]
    for a in range(limits):
        alpha, beta = margin.rigid_alpha[a], margin.rigid_beta[a]
        sums.value[a, _NONE], sums.drift[a, _NONE] = alpha * q, alpha
        sums.bend_q[a, _NONE], sums.bend_tau[a, _NONE] = 0.0, 0.0
        sums.bend_mixed[a, _NONE] = abs(beta)
        sums.tilt[a, _NONE] = n * _EPS * (abs(alpha) + abs(beta)) + margin.rigid_doubt[a]
        sums.rounding[a, _NONE] = sums.tilt[a, _NONE] * last + margin.silent[a] / (q - half)
    for j in range(n):
        r = margin.root[j]
        phase, off = r * q, margin.root_error[j] * last
        sine, cosine = math.sin(phase), math.cos(phase)
        rough = 2.0 * _EPS * (1.0 + phase)
        blur = rough + off
        reach = r * half + blur
        smallest = max(abs(cosine) - reach, 0.0)
        modes.sine[j], modes.cosine[j], modes.blur[j] = sine, cosine, blur
        modes.smallest[j], modes.largest[j] = smallest, min(abs(cosine) + reach, 1.0)
        away = smallest > 0.5 * abs(cosine)
        is_far = away and abs(cosine) >= _NEAR
        if not is_far:
            modes.near[count] = j
            count += 1
        # Brackets of slow modes, and so their roundings, are as small as their phases.
        slow = min(1.0, 2.0 * phase)
        for a in range(limits):
            alpha, beta, doubt = margin.alpha[a, j], margin.beta[a, j], margin.doubt[a, j]
            b, size = abs(beta), abs(alpha) + abs(beta)
            far.value[a, j], far.slope[a, j], far.drift[a, j] = 0.0, 0.0, 0.0
            value, drift, rounding, tilt = 0.0, 0.0, 0.0, 0.0
            bend_q, bend_mixed, bend_tau = 0.0, 0.0, 0.0
            if away:
                bound = 1.0 / smallest
                bend_mixed = b * bound * (1.0 + r * last * (1.0 + bound))
                bend_tau = b * r * last * last * bound
            if is_far:
                secant = 1.0 / cosine
                far.value[a, j], far.slope[a, j] = beta * secant / r, beta * secant
                far.drift[a, j] = beta * sine * secant * secant
                value, drift = alpha * sine * secant / r, alpha * secant * secant
                spread = size * (blur * (1.0 + 2.0 * bound) + n * _EPS)
                tilt = bound * bound * (doubt + spread)
                bend_q = r * bound * (b + 2.0 * bound * (b + bound * size))
                wrong = off * (1.0 + bound) + slow * (rough * (1.0 + bound) + n * _EPS)
                rounding = (slow * doubt + size * wrong) * bound / r
            sums.value[a, j + 1] = sums.value[a, j] + value
            sums.drift[a, j + 1] = sums.drift[a, j] + drift
            sums.bend_q[a, j + 1] = sums.bend_q[a, j] + bend_q
            sums.bend_mixed[a, j + 1] = sums.bend_mixed[a, j] + bend_mixed
            sums.bend_tau[a, j + 1] = sums.bend_tau[a, j] + bend_tau
            sums.tilt[a, j + 1] = sums.tilt[a, j] + tilt
            sums.rounding[a, j + 1] = sums.rounding[a, j] + rounding
    for a in range(limits):
        sums.floor[a, n], least = 0.0, 0.0
        for j in range(n - 1, -1, -1):
            least += _least(margin, modes, a, j, half)
            sums.floor[a, j] = least * _UP
    return count


@inline
def _least(margin: Margin, modes: _Modes, a: int, j: int, half: float) -> float:
    """Return a lower bound of the term of a mode over a cell, at all tau.

    Where the tangent is positive, so is the bracket, or it is no less than minus the squared
    cosine, as ``1 - |sin| <= cos^2``: such a mode takes little away, however near its pole is.
    """
    r, sine = margin.root[j], abs(modes.sine[j])
    alpha, b, doubt = margin.alpha[a, j], abs(margin.beta[a, j]), margin.doubt[a, j]
    reach = r * half + modes.blur[j]
    rises = modes.sine[j] * modes.cosine[j] > modes.blur[j] and sine > reach
    least, smallest = -np.inf, r * modes.smallest[j]
    if rises and (a == margin.struck or alpha - doubt >= b):
        least = -(b + doubt) * modes.largest[j] / r
    elif rises and smallest > 0.0:
        least = min(alpha * (sine - reach) - b - doubt, 0.0) / smallest
    elif smallest > 0.0:
        least = -(alpha * min(sine + reach, 1.0) + b + doubt) / smallest
    return float(least)


@inner
def _clear(cell: _Cell) -> float:
    """Return for how long before an impact the struck coordinate keeps within its limits.

    With d = 1 - tau every mode adds ``beta [tan(theta) (1 - cos(theta d)) + sin(theta d)]/Omega``,
    of which only a negative tangent and the cubic term of the sine can be negative.
    """
    margin, modes = cell.margin, cell.modes
    a, last = margin.struck, cell.q + cell.half
    first, second, third = margin.rigid_beta[a] - margin.rigid_doubt[a], 0.0, 0.0
    for j in range(margin.root.size):
        beta, phase = margin.beta[a, j] + margin.doubt[a, j], margin.root[j] * last
        first += margin.beta[a, j] - margin.doubt[a, j]
        third += beta * phase * phase * last / 6.0
        reach = margin.root[j] * cell.half + modes.blur[j]
        # No pole lies inside the cell: the tangent changes its sign at a zero only.
        if modes.sine[j] * modes.cosine[j] < modes.blur[j] or abs(modes.sine[j]) < reach:
            if modes.smallest[j] == 0.0:
                return 0.0
            tangent = min(abs(modes.sine[j]) + reach, 1.0) / modes.smallest[j]
            second += 0.5 * beta * tangent * phase * last
    if first <= 0.0:
        return 0.0
    if third == 0.0 and second == 0.0:
        return 2.0
    first *= cell.q - cell.half
    time = 2.0 * first / (second + math.sqrt(second * second + 4.0 * first * third))
    return float(min(time / _UP, 2.0))


@inline
def _near_pole(cell: _Cell, a: int, j: int, tau: float, width: float) -> _Bounds:
    """Return the bounds of the term of a mode near its pole, in one limit."""
    modes, q, half = cell.modes, cell.q, cell.half
    r, alpha, beta = cell.margin.root[j], cell.margin.alpha[a, j], cell.margin.beta[a, j]
    sine, cosine, S, C = modes.sine[j], modes.cosine[j], modes.at_sine[j], modes.at_cosine[j]
    smallest, largest, doubt = modes.smallest[j], modes.largest[j], cell.margin.doubt[a, j]
    phase, last, size = r * q, q + half, abs(alpha) + abs(beta)
    bracket = (alpha * sine - beta * S) * (1.0 if cosine > 0.0 else -1.0)
    drift = r * half * abs(alpha * cosine - beta * tau * C) + size * modes.blur[j]
    drift += 0.5 * r * r * half * half * size
    is_struck = a == cell.margin.struck
    # There alpha and beta are the same number, a factor of the bracket.
    loose = doubt * (abs(bracket) + drift) / size if is_struck else doubt
    drift, noise = (drift + loose) * _UP, size * modes.blur[j] + loose
    # A lower bound of a quotient has the largest denominator if it is positive, else the smallest;
    # where that is zero it is infinite.
    below, above = bracket - drift, bracket + drift
    low = below / (r * (largest if below >= 0.0 else smallest))
    high = above / (r * (largest if above <= 0.0 else smallest))
    least = low
    if smallest <= 0.5 * abs(cosine):
        sway = width * (abs(beta) * (phase * abs(C) + r * half * (1.0 + r * last)))
        sway += 0.5 * abs(beta) * (r * last * width) ** 2
        below -= sway
        least = below / (r * (largest if below >= 0.0 else smallest))
    # The bracket is never smaller than minus, or larger than plus, the squared cosine.
    floor = (abs(beta) + doubt) * largest / r
    if is_struck or alpha - doubt >= abs(beta):
        if sine * cosine > modes.blur[j]:
            low, least = max(low, -floor), max(least, -floor)
        elif sine * cosine < -modes.blur[j]:
            high = min(high, floor)
    scale = r * max(abs(cosine), _EPS)
    return _Bounds(bracket / scale, low, high, least, noise / scale)


@inline
def _resolved(cell: _Cell, width: float) -> int:
    """Return how many of the slowest modes change so little over ``+- width`` in tau."""
    root, many = cell.margin.root, cell.margin.root.size
    reach = (cell.q + cell.half) * width
    while many > 0 and root[many - 1] * reach > _SLOW:
        many -= 1
    return many


@inline
def _box(cell: _Cell, a: int, tau: float, width: float, many: int) -> tuple[_Bounds, float]:
    """Return bounds of P of one limit over a box of the cell and ``tau +- width``, and a slope.

    Of the slowest ``many`` modes they are those of their sum, at its centre that of all others by
    their least values; the slope by tau is that of the sum.
    """
    root, modes, sums, q, half = cell.margin.root, cell.modes, cell.sums, cell.q, cell.half
    for j in range(many):
        modes.at_sine[j], modes.at_cosine[j] = sine_cosine(root[j] * q * tau, 0.0)
    in_value, in_slope, in_drift = cell.far.value[a], cell.far.slope[a], cell.far.drift[a]
    value, slope, drift = 0.0, cell.margin.rigid_beta[a], 0.0
    for j in range(many):
        S, C = modes.at_sine[j], modes.at_cosine[j]
        value += in_value[j] * S
        slope += in_slope[j] * C
        drift += in_drift[j] * S
    value = sums.value[a, many] - value - cell.margin.rigid_beta[a] * tau * q
    slope_q, slope_tau = sums.drift[a, many] - drift - tau * slope, -q * slope
    rounding = sums.rounding[a, many] + (cell.near + 4) * _EPS * abs(value)
    tilt = sums.tilt[a, many]
    spread = half * (abs(slope_q) + tilt + 0.5 * half * sums.bend_q[a, many]) + rounding
    spread *= _UP
    low, high, least = value - spread, value + spread, value - spread
    each = (cell.near + 4) * _EPS
    for k in range(cell.near):
        j = modes.near[k]
        if j >= many:
            break
        term = _near_pole(cell, a, j, tau, width)
        value, rounding = value + term.value, rounding + term.rounding
        low += term.low - each * abs(term.low)
        high += term.high + each * abs(term.high)
        least += term.least - each * abs(term.least)
        if modes.smallest[j] > 0.5 * abs(modes.cosine[j]):
            beta, bound = cell.margin.beta[a, j], 1.0 / modes.smallest[j]
            slope_tau -= beta * q * modes.at_cosine[j] / modes.cosine[j]
            wrong = abs(beta) * (modes.blur[j] * (1.0 + bound) + each) + cell.margin.doubt[a, j]
            tilt += wrong * bound
    bend = half * sums.bend_mixed[a, many] + 0.5 * width * sums.bend_tau[a, many]
    steep = (abs(slope_tau) + (q + half) * tilt + bend) * _UP
    least += sums.floor[a, many]
    least -= each * abs(least)
    return _Bounds(value, low, high, least - width * steep, rounding), slope_tau


@inner
def _decide(
    cell: _Cell, hint: float, hinted: int, waiting: _Boxes, stack: _Boxes, bottom: int, top: int
) -> _Verdict:
    """Decide one cell from its undecided boxes, numbers bottom to top.

    The hint is where P was smallest in the cell before, and of which limit.
    """
    clear = 1.0 - _clear(cell)
    n = cell.margin.root.size
    examined, end, smallest, settled, patience = 0, top, np.inf, False, _PATIENCE
    best, whose_best = hint, hinted
    # First the hint, as a box without width.
    for k in range(bottom - 1, top):
        a, depth = hinted, 0
        stack.low[depth] = stack.high[depth] = hint
        if k >= bottom:
            a = waiting.limit[k]
            stack.low[depth], stack.high[depth] = waiting.low[k], waiting.high[k]
            if a == cell.margin.struck:
                stack.high[depth] = min(waiting.high[k], clear)
        depth += k < bottom or stack.low[depth] < stack.high[depth]
        while depth > 0:
            depth -= 1
            low_tau, high_tau = stack.low[depth], stack.high[depth]
            tau, width = 0.5 * (low_tau + high_tau), 0.5 * (high_tau - low_tau)
            many = _resolved(cell, width)
            bounds, slope = _box(cell, a, tau, width, many)
            examined += 1
            if bounds.least > 0.0:
                continue
            centre = bounds
            if many < n:  # what its centre tells, by all modes
                centre, slope = _box(cell, a, tau, 0.0, n)
                examined += 1
            value, low = centre.value, centre.low
            if centre.high < 0.0:
                return _Verdict(PHANTOM, tau, a, top, examined, False)
            if value < smallest:
                smallest, best, whose_best = value, tau, a
            # Divided along tau as long as its width in tau is what keeps the box undecided; once
            # a narrower cell is needed, only to look for what is negative all over this one.
            patience -= patience < _PATIENCE or low <= 0.0
            if k < bottom:
                continue
            loss = bounds.least if many == n else -np.inf
            wide = value > 0.0 and low - loss > 0.25 * (value - low) and width > 1e-9
            if wide and patience > 0 and depth < _STACK - 2:
                # P falls towards the half that is looked at first.
                first, second = (0, 1) if slope > 0.0 else (1, 0)
                stack.low[depth + second], stack.high[depth + second] = low_tau, tau
                stack.low[depth + first], stack.high[depth + first] = tau, high_tau
                depth += 2
                continue
            if value - low <= 4.0 * centre.rounding and abs(value) <= 8.0 * centre.rounding:
                settled = True
            beside = end > top and waiting.limit[end - 1] == a
            if beside and waiting.low[end - 1] == high_tau:
                waiting.low[end - 1] = low_tau
            elif beside and waiting.high[end - 1] == low_tau:
                waiting.high[end - 1] = high_tau
            elif end < _BOXES:
                waiting.low[end], waiting.high[end], waiting.limit[end] = low_tau, high_tau, a
                end += 1
            else:
                settled = True
    if end == top:
        return _Verdict(ADMISSIBLE, best, whose_best, top, examined, False)
    return _Verdict(UNDECIDED, best, whose_best, end, examined, settled)


@inner
def _divide(waiting: _Boxes, limits: int, phase: float) -> int:
    """Put the first boxes of a cell in place, by the largest phase in it; return their number."""
    boxes, kept = min(max(4, math.ceil(2.0 * phase / _FIRST_BOX)), _FIRST_BOXES), 0
    for a in range(limits):
        for k in range(boxes):
            waiting.low[kept] = 1.0 - 2.0 * (k + 1) / boxes
            waiting.high[kept] = 1.0 - 2.0 * k / boxes
            waiting.limit[kept] = a
            kept += 1
    return kept


@kernel
def survey(margin: Margin, start: float, stop: float, resolution: float, budget: int) -> Survey:
    """Decide where in a range of q, in which the impulse is positive, solutions are admissible.

    Parameters
    ----------
    margin : Margin
    start, stop : float
        The range; no pole lies inside.
    resolution : float
        Cells that are narrower, relative to q, are not divided again.
    budget : int
        Boxes that may be evaluated before the rest is left undecided.
    """
    limits, n = margin.alpha.shape
    many, sizes = (limits, n), (limits, n + 1)
    modes = _Modes(
        np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n),
        np.empty(n, np.int64),
    )  # fmt: skip
    far = _Far(np.empty(many), np.empty(many), np.empty(many))
    sums = _Sums(
        np.empty(sizes), np.empty(sizes), np.empty(sizes), np.empty(sizes), np.empty(sizes),
        np.empty(sizes), np.empty(sizes), np.empty(sizes),
    )  # fmt: skip
    waiting = _Boxes(np.empty(_BOXES), np.empty(_BOXES), np.empty(_BOXES, np.int64))
    stack = _Boxes(np.empty(_STACK), np.empty(_STACK), np.empty(0, np.int64))
    lefts, rights = np.empty(_CELLS), np.empty(_CELLS)
    bottoms, tops = np.empty(_CELLS, np.int64), np.empty(_CELLS, np.int64)
    bounds, status = np.empty(_SEGMENTS + 1), np.empty(_SEGMENTS, np.int64)
    witness, limit = np.empty(_SEGMENTS), np.empty(_SEGMENTS, np.int64)
    count, spent, hint, hinted, fastest = 0, 0, 0.0, margin.struck, 0.0
    for j in range(n):
        fastest = max(fastest, margin.root[j])
    parts = max(1, math.ceil((stop - start) * fastest / _FIRST_CELL))
    bounds[count] = start
    for part in range(parts):
        depth, right = 0, start + (stop - start) * (part + 1) / parts
        if part + 1 == parts:
            right = stop
        lefts[depth], rights[depth] = start + (stop - start) * part / parts, right
        bottoms[depth], tops[depth] = 0, _divide(waiting, limits, fastest * right)
        depth += 1
        while depth > 0:
            depth -= 1
            left, right, bottom = lefts[depth], rights[depth], bottoms[depth]
            q, half = 0.5 * (left + right), 0.5 * (right - left)
            near = _prepare(margin, modes, far, sums, q, half)
            cell = _Cell(margin, modes, far, sums, q, half, near)
            verdict = _decide(cell, hint, hinted, waiting, stack, bottom, tops[depth])
            hint, hinted, spent = verdict.tau, verdict.limit, spent + verdict.boxes
            wide = right - left > resolution * right and left < q < right
            more = wide and not verdict.settled and spent <= budget and depth < _CELLS - 5
            if verdict.status == UNDECIDED and more:
                # The left half is next, with the boxes that are left.
                bottom = tops[depth]
                lefts[depth], rights[depth] = q, right
                lefts[depth + 1], rights[depth + 1] = left, q
                bottoms[depth], tops[depth] = bottom, verdict.top
                bottoms[depth + 1], tops[depth + 1] = bottom, verdict.top
                depth += 2
            elif count > 0 and (status[count - 1] == verdict.status or count == _SEGMENTS - 1):
                if status[count - 1] != verdict.status:
                    status[count - 1] = UNDECIDED
                bounds[count] = right
            else:
                status[count], witness[count], limit[count] = verdict.status, hint, hinted
                count += 1
                bounds[count] = right
    return Survey(bounds[: count + 1], status[:count], witness[:count], limit[:count], spent)
