"""Headers, read and written, by the examples and rules of their standards."""

from __future__ import annotations

import base64
import hashlib

import pytest

from vibroimpact_service.api import answers, request_headers
from vibroimpact_service.results.encoders import HDF5, JSON
from vibroimpact_service.use_case.evaluation import Preference


@pytest.mark.parametrize(
    ("accept", "wanted"),
    [
        ("", JSON),
        ("*/*", JSON),
        ("application/*", JSON),
        ("application/json", JSON),
        ("Application/X-HDF5", HDF5),
        ("application/json;q=0.5, application/x-hdf5", HDF5),
        ("application/json;q=0, */*", HDF5),
        ("application/x-hdf5;q=0.2, */*;q=0.1", HDF5),
        ("text/html, application/json;q=0.1", JSON),
        ("application/json; charset=utf-8", JSON),
        ("text/html", None),
        ("application/json;q=0", None),
        ("application/json;q=nan", None),
        ("application/problem+json", None),
        (";;,,", None),
    ],
)
def test_accept(accept: str, wanted: str | None) -> None:
    assert request_headers.preferred(accept) == wanted


@pytest.mark.parametrize(
    ("header", "number"),
    [(None, 0), ("", 0), ("17", 17), ("\u00b2", 0), ("1\u00b2", 0), ("-1", 0), ("9" * 40, 0)],
)
def test_last_event(header: str | None, number: int) -> None:
    assert request_headers.last_event(header) == number


@pytest.mark.parametrize(
    ("headers", "expected"),
    [
        ([], Preference()),
        (["respond-async"], Preference(True)),
        (["Respond-Async, wait=10"], Preference(True, 10)),
        (["respond-async", "wait=5"], Preference(True, 5)),
        (['wait="7"'], Preference(False, 7)),
        (["wait=3; foo=1"], Preference(False, 3)),
        (["wait=0"], Preference(False, 0)),
        (["wait=1, wait=9"], Preference(False, 1)),
        (["wait=3600"], Preference(False, request_headers.LONGEST_PREFER_WAIT)),
        (["wait=-1, return=minimal"], Preference()),
        (["wait=nan"], Preference()),
        (["wait=1e9"], Preference()),
    ],
)
def test_prefer(headers: list[str], expected: Preference) -> None:
    assert request_headers.preference(headers) == expected


def test_preference_applied_names_what_was_obeyed() -> None:
    asked = request_headers.preference(["wait=3600, respond-async"])
    applied = request_headers.preference_applied(asked)
    assert applied == {"Preference-Applied": "respond-async, wait=20"}
    assert request_headers.preference_applied(Preference()) == {}


def test_entity_tags() -> None:
    tag = '"ab"'
    for condition in ('"ab"', 'W/"ab"', '"x", "ab"', "*", ' "ab" '):
        assert request_headers.is_known(condition, tag)
    for condition in ('"a"', "ab", ""):
        assert not request_headers.is_known(condition, tag)


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        (None, None),
        ("bytes=0-0", (0, 1)),
        ("bytes=2-5", (2, 6)),
        ("bytes=7-", (7, 10)),
        ("bytes=-3", (7, 10)),
        ("bytes=-30", (0, 10)),
        ("bytes=5-50", (5, 10)),
        ("bytes=5-2", None),
        ("bytes=0-1,4-5", None),
        ("bytes=-", None),
        ("items=0-1", None),
        ("bytes=" + "9" * 30 + "-", None),
    ],
)
def test_ranges_of_ten_bytes(header: str | None, expected: tuple[int, int] | None) -> None:
    assert request_headers.byte_range(header, 10) == expected


@pytest.mark.parametrize("header", ["bytes=10-", "bytes=99-100", "bytes=-0"])
def test_ranges_beyond_the_end(header: str) -> None:
    with pytest.raises(request_headers.UnsatisfiableRangeError):
        request_headers.byte_range(header, 10)


def test_repr_digest() -> None:
    sha256 = hashlib.sha256(b"data")
    expected = base64.b64encode(sha256.digest()).decode()
    assert answers.repr_digest(sha256.hexdigest()) == f"sha-256=:{expected}:"


def test_server_timing_is_in_milliseconds() -> None:
    assert answers.server_timing({"plan": 0.0015, "solve": 2}) == (
        "plan;dur=1.500, solve;dur=2000.000"
    )
