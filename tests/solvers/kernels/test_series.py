"""Power series against polynomials of numpy and against mpmath."""

from __future__ import annotations

import mpmath
import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.solvers.kernels.compiled import compiled
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.series import (
    LONGEST,
    PADDED,
    place_of,
    power,
    product,
    raised,
    square,
    summed,
)
from vibroimpact_solvers.kernels.soft_forces import side_kept

TERMS = 24
first_change = compiled(side_kept)
TERM = st.floats(-1.0, 1.0).filter(lambda a: a == 0.0 or abs(a) > 1e-6)


@numba.njit(error_model="numpy")  # type: ignore[untyped-decorator]
def grown(u: Floats, f: Floats, exponent: float) -> None:
    rising, past = np.zeros(PADDED), np.zeros(PADDED)
    for k in range(1, u.size):
        if k > 1:
            rising[place_of(k)], past[place_of(k)] = k * u[k], u[k]
        f[k] = power(u[k], u[1], rising, past, f, k, exponent, 1.0 / k, 1.0 / u[0])


@numba.njit(error_model="numpy")  # type: ignore[untyped-decorator]
def multiplied(
    u: Floats, v: Floats, u_past: Floats, v_past: Floats, squares: Floats, products: Floats
) -> float:
    for k in range(u.size):
        squares[k] = square(u, u_past, k)
        products[k] = product(u, v, v_past, k)
    return summed(u, u.size - 1, 0.5)


def in_reverse(u: Floats) -> Floats:
    past = np.zeros(PADDED)
    past[LONGEST - u.size + 1 : LONGEST + 1] = u[::-1]
    return past


@numba.njit(error_model="numpy")  # type: ignore[untyped-decorator]
def whole_power(base: float, exponent: int) -> float:
    return raised(base, exponent)


def test_products_and_sums_against_polynomials() -> None:
    u, v = np.random.default_rng(1).standard_normal((2, TERMS))
    squares, products = np.empty((2, TERMS))
    total = multiplied(u, v, in_reverse(u), in_reverse(v), squares, products)
    np.testing.assert_allclose(squares, np.convolve(u, u)[:TERMS], rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(products, np.convolve(u, v)[:TERMS], rtol=0.0, atol=1e-13)
    assert total == pytest.approx(np.polynomial.polynomial.polyval(0.5, u), rel=1e-14)


@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.0, 7.0, 17.0, 17.3, 80.0])
def test_powers_against_mpmath(exponent: float) -> None:
    u = np.random.default_rng(2).standard_normal(TERMS) * 0.3 ** np.arange(TERMS)
    u[0] = 0.9
    f = np.zeros(PADDED)
    f[0] = 2.5 * u[0] ** exponent
    grown(u, f, exponent)
    with mpmath.workdps(40):
        terms = [mpmath.mpf(a) for a in u.tolist()]

        def function(t: mpmath.mpf) -> mpmath.mpf:
            return mpmath.mpf(2.5) * mpmath.polyval(terms, t, asc=True) ** mpmath.mpf(exponent)

        expected = np.array([float(a) for a in mpmath.taylor(function, 0, TERMS - 1)])
    size = np.abs(expected).max()
    np.testing.assert_allclose(f[:TERMS], expected, rtol=1e-11, atol=1e-12 * size)


@pytest.mark.parametrize("exponent", [1, 2, 3, 5, 17, 64])
def test_whole_powers(exponent: int) -> None:
    assert whole_power(-1.1, exponent) == pytest.approx((-1.1) ** exponent, rel=1e-13)


@settings(deadline=None)
@given(
    st.lists(
        st.floats(-1.0, 1.0).filter(lambda a: a == 0.0 or abs(a) > 1e-6), min_size=3, max_size=8
    ),
    st.floats(0.1, 3.0),
)
def test_the_first_change_of_sides_is_not_missed(terms: list[float], s: float) -> None:
    """Before the time that is found no value is on the other side; there, one is (almost)."""
    series = np.array(terms)
    if abs(series[0]) < 1e-3:
        series[0] = 0.25
    side = 1.0 if series[0] > 0.0 else -1.0
    found = first_change(series, series.size - 1, s, side)
    assert 0.0 < found <= s
    rounding = 1e-14 * float(np.abs(series) @ s ** np.arange(series.size))
    before = np.polynomial.polynomial.polyval(np.linspace(0.0, found, 2001), series)
    assert (side * before >= -rounding).all()
    if found < s:
        assert abs(before[-1]) <= rounding


def test_a_dip_within_a_series_is_found() -> None:
    """(t - 0.5)^2 - 1e-10 is below zero for the fifty-thousandth of the time."""
    dip, none = np.array([0.25 - 1e-10, -1.0, 1.0]), np.array([0.25 + 1e-10, -1.0, 1.0])
    assert first_change(dip, 2, 1.0, 1.0) == pytest.approx(0.5 - 1e-5)
    assert first_change(none, 2, 1.0, 1.0) == 1.0
