"""First passages against dense evaluation of the envelopes, on random polynomials."""

from __future__ import annotations

from math import factorial

import numpy as np
import pytest

from tests.solvers.kernels.compiled import compiled
from vibroimpact_solvers.kernels.passages import DEPTH, ORDER, first_passage

passage = compiled(first_passage)


@pytest.mark.parametrize("leaving", [False, True])
def test_the_first_root_of_an_envelope_is_found(leaving: bool) -> None:
    """A wall that is being left counts from h > 0 on; none of 600 random passages is missed."""
    random = np.random.default_rng(4)
    work = np.zeros((DEPTH + 5, DEPTH + 2))
    powers = 2.0 ** np.arange(ORDER)
    met = turned = 0
    for _ in range(600):
        d = random.standard_normal(ORDER) * powers
        bound, H = random.random() * 2.0**ORDER, 0.1 + 1.4 * random.random()
        above, below = 0.01 + 1.2 * random.random(2)
        if leaving:
            above, d[1] = 0.0, -abs(d[1])
        margin = 0.3 * min(above, below)
        h, side, near = passage(d, bound, H, above, below, work, np.inf, margin)
        t = np.linspace(0.0, H, 20001)
        p = sum(d[k] * t**k / factorial(k) for k in range(1, ORDER))
        rest = bound * t**ORDER / factorial(ORDER)
        # A wall, or its margin where it turns before the wall; one that is left has none.
        inside = (p + rest < above) & (p - rest > -below)
        before = (t > 0.0) & (t < h)
        assert inside[before].all()
        clear = (p + rest < above - margin) & (p - rest > margin - below)
        if near:
            inside = clear
            turned += 1
        elif margin > 0.0:  # what has come into a margin does not leave it before the wall
            assert (np.diff(clear[before].astype(int)) <= 0).all()
        inside[0] = True
        outside = np.flatnonzero(~inside)
        expected = t[outside[0]] if outside.size else H
        np.testing.assert_allclose(h, expected, rtol=0.0, atol=1.1 * H / 20000)
        assert (side != 0) == (outside.size > 0)
        met += side != 0
    assert met > 100
    assert leaving or turned > 10
