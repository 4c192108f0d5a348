"""What kernels as plain Python have in place of compiled code, against rational arithmetic."""

from __future__ import annotations

import math
import struct
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from vibroimpact_solvers.kernels import jit, plain

MANTISSA = st.one_of(
    st.sampled_from([2**52, 2**52 + 1, 2**53 - 1, 2**53 - 2, 3 * 2**51, 2**27 + 1, 2**26 - 1, 1]),
    st.integers(1, 2**53 - 1),
)
NEAR = st.builds(
    lambda m, e, sign: sign * math.ldexp(m, e),
    MANTISSA,
    st.integers(-110, 10),
    st.sampled_from([1.0, -1.0]),
)
ANY = st.one_of(NEAR, st.floats())


@jit.kernel
def fused(a: float, b: float, c: float) -> float:
    return jit.fma(a, b, c)


@jit.kernel
def odd(a: float) -> bool:
    return jit.is_odd_bit(a)


def rounded_once(a: float, b: float, c: float) -> float:
    """Return a * b + c of finite numbers by rational arithmetic."""
    exact = Fraction(a) * Fraction(b) + Fraction(c)
    if exact == 0:
        return a * b + c if a == 0.0 or b == 0.0 else 0.0
    try:
        return float(exact)
    except OverflowError:
        return math.inf if exact > 0 else -math.inf


def bits(a: float) -> bytes | None:
    return None if math.isnan(a) else struct.pack("<d", a)


@settings(max_examples=500, deadline=None)
@given(ANY, ANY, ANY)
@example(1e308, 10.0, -math.inf)
@example(1e308, 10.0, -1.7e308)
@example(math.inf, 0.0, 1.0)
@example(-0.0, 1.0, 0.0)
@example(-0.0, 1.0, -0.0)
@example(5e-324, 0.5, 5e-324)
@example(5e-324, 0.5, -5e-324)
@example(-5e-324, 0.25, 0.0)
@example(2.0**-537, 2.0**-538, -(2.0**-1074))
@example(1.0 + 2.0**-52, 1.0 - 2.0**-52, -1.0)
def test_products_and_sums_are_rounded_once(a: float, b: float, c: float) -> None:
    found = plain.fma(a, b, c)
    assert bits(found) == bits(fused(a, b, c))
    if math.isfinite(a) and math.isfinite(b) and math.isfinite(c):
        assert bits(found) == bits(rounded_once(a, b, c))


@settings(max_examples=500, deadline=None)
@given(NEAR, NEAR, st.integers(-110, 110), st.sampled_from([1.0, -1.0]), st.integers(-1, 1))
def test_what_is_next_to_a_tie_is_rounded_once(
    a: float, b: float, place: int, sign: float, beside: int
) -> None:
    """c is a power of two, or next to one, around the product and what rounding takes from it."""
    c = sign * math.ldexp(1.0, math.frexp(a * b)[1] + place)
    c += beside * math.ulp(c)
    found = plain.fma(a, b, c)
    assert bits(found) == bits(rounded_once(a, b, c)) == bits(fused(a, b, c))


@pytest.mark.parametrize("off", [-1, 1])
@pytest.mark.parametrize("power", [0, 1, 7])
def test_a_tie_is_decided_by_what_is_left(power: int, off: int) -> None:
    """Half a unit of the last place, and a hundred digits later a bit more or less."""
    half = 2.0 ** (power - 53)
    a, b = half * (1.0 + off * 2.0**-50), 1.0 + 2.0**-52
    c = 2.0**power * (1.0 + 2.0**-52)
    assert plain.fma(a, b, c) == rounded_once(a, b, c) == fused(a, b, c)
    c = 2.0**power  # below it numbers are twice as close
    assert plain.fma(-0.5 * a, b, c) == rounded_once(-0.5 * a, b, c) == fused(-0.5 * a, b, c)


@settings(deadline=None)
@given(st.floats())
def test_the_last_bit(a: float) -> None:
    assert plain.is_odd_bit(a) == odd(a)
    assert plain.is_odd_bit(a) == bool(np.array([a]).view(np.uint64)[0] & np.uint64(1))


FIELDS = [("time", "f8"), ("size", "f8"), ("base", "i8")]
"""All numbers of numpy have a size and a base of their own."""
RECORD = jit.record(FIELDS)


@jit.kernel
def written(rows: Any, k: int) -> float:
    made = np.empty(1, RECORD)
    row, here = rows[k], made[0]
    here.size, row.base = row.size + 1.0, row.base + 2
    row.time = here.size
    return float(here.size)


def test_fields_of_records_are_attributes() -> None:
    rows = np.zeros(3, RECORD)
    rows["size"] = [1.0, 2.0, 3.0]
    assert written(rows, 1) == 3.0
    assert written(rows[1:], 0) == 3.0
    assert rows["base"].tolist() == [0, 4, 0]
    assert rows["time"].tolist() == [0.0, 3.0, 0.0]
    assert rows.dtype == np.dtype(FIELDS)


def test_a_record_of_no_field_is_refused() -> None:
    with pytest.raises(AttributeError):
        np.zeros(1, RECORD)[0].other  # noqa: B018


def divided(a: float, b: float) -> float:
    return a / b


def halved_root(a: float) -> float:
    return 0.5 / math.sqrt(a)


def logarithm(a: float) -> float:
    return math.log(a)


def grown(a: float) -> float:
    return math.exp(a) - math.sinh(-a)


IN_PYTHON = [plain.entered(each) for each in (divided, halved_root, logarithm, grown)]
IN_BOTH = [jit.kernel(each) for each in (divided, halved_root, logarithm, grown)]


@pytest.mark.parametrize(
    ("which", "given", "expected"),
    [
        (0, (1.0, 0.0), math.inf),
        (0, (-1.0, 0.0), -math.inf),
        (0, (0.0, 0.0), math.nan),
        (1, (0.0,), math.inf),
        (1, (-1.0,), math.nan),
        (1, (4.0,), 0.25),
        (2, (0.0,), -math.inf),
        (2, (-1.0,), math.nan),
        (3, (1000.0,), math.inf),
    ],
)
def test_arithmetic_goes_on_beyond_the_finite_numbers(
    which: int, given: tuple[float, ...], expected: float
) -> None:
    for functions in (IN_PYTHON, IN_BOTH):
        assert bits(functions[which](*given)) == bits(expected)


def test_outside_kernels_errors_are_as_before() -> None:
    IN_PYTHON[0](1.0, 0.0)
    with pytest.raises(ValueError, match="math domain error"):
        math.sqrt(float(IN_PYTHON[0](-1.0, 1.0)))
    with pytest.warns(RuntimeWarning, match="divide by zero"):
        np.float64(1.0) / np.float64(0.0)


def test_what_is_handed_over_keeps_its_form() -> None:
    """Numbers within tuples are doubles of numpy, arrays and integers are those of the caller."""
    array, seen = np.ones(2), []
    plain.entered(lambda *given: seen.extend(given))((1.5, (array, 2)), 3, True)
    (number, (same, two)), three, true = seen
    assert isinstance(number, np.float64)
    assert same is array
    assert (number, two, three, true) == (1.5, 2, 3, True)
    assert type(two) is type(three) is int
    assert type(true) is bool
