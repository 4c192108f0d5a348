"""Bodies become content or a problem, quickly, whatever they hold."""

from __future__ import annotations

import json
import math
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vibroimpact_service import problems
from vibroimpact_service.documents import parse
from vibroimpact_service.problems import ProblemError


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"{",
        b"[1,]",
        b"{'a': 1}",
        b'{"a": 1} {"a": 1}',
        b'{"a": 1, "a": 2}',
        b'{"x": {"a": 1, "b": [], "a": 1}}',
        b'"\\ud800"',
        b'{"\\udfff": 1}',
        b'"\xff"',
        b"\xef\xbb\xbf{}",
        b"\x89HDF\r\n\x1a\n",
        b"PK\x03\x04",
        b"[" * 100_000,
        b'{"a":' * 100_000,
        b"9" * 100_000,
        b"-",
        b"0x10",
        b"01",
        b"\x00",
    ],
)
def test_what_is_not_json_is_malformed(body: bytes) -> None:
    with pytest.raises(ProblemError) as caught:
        parse.json(body)
    assert caught.value.type is problems.MALFORMED


def test_a_repeated_name_is_not_quoted() -> None:
    with pytest.raises(ProblemError) as caught:
        parse.json(b'{"s3cret": 1, "s3cret": 2}')
    assert "s3cret" not in caught.value.detail
    assert "twice" in caught.value.detail
    assert "line 1" in caught.value.detail


def test_too_many_strings_are_refused_before_they_are_read() -> None:
    body = json.dumps({str(i): i for i in range(200_001)}).encode()
    with pytest.raises(ProblemError) as caught:
        parse.json(body)
    assert caught.value.type is problems.TOO_LARGE


def test_nan_and_overflow_reach_the_model_that_names_their_field() -> None:
    content = parse.json(b"[NaN, Infinity, -Infinity, 1e400]")
    assert math.isnan(content[0])
    assert content[1:] == [math.inf, -math.inf, math.inf]


@given(st.integers(0, 2**64 - 1))
@settings(deadline=None, max_examples=500)
def test_floats_are_read_to_the_bit(bits: int) -> None:
    (value,) = struct.unpack("d", struct.pack("Q", bits))
    if math.isfinite(value):
        (read,) = parse.json(json.dumps([value]).encode())
        assert struct.pack("d", read) == struct.pack("d", value)
        (read,) = parse.json(f"[{value:.25e}]".encode())
        assert read == value
