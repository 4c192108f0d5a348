"""Numbers that callers give: what is no number is refused by the argument's name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import vibroimpact as vi
from vibroimpact import arguments
from vibroimpact.requests import REQUESTS

CHAIN = vi.chain(3, [vi.constraint(1, 0.2)])


@pytest.mark.parametrize("given", [3, 3.0, np.int64(3), np.float64(3.0), np.array(3), True + 2])
def test_integers_of_every_type(given: Any) -> None:
    assert arguments.integer("count", given) == 3
    assert type(arguments.integer("count", given)) is int


def test_large_integers_keep_their_digits() -> None:
    assert arguments.integer("seed", 2**63 + 1) == 2**63 + 1


@pytest.mark.parametrize("given", [1.5, float("nan"), float("inf"), np.float32("nan")])
def test_fractions_are_no_integers(given: float) -> None:
    """They were cut off before."""
    with pytest.raises(ValueError, match=r"^periods must be an integer, not "):
        arguments.integer("periods", given)


@pytest.mark.parametrize("given", ["1", b"1", None, [], {}, [1, 2], 1 + 2j, len, 10**400])
def test_what_is_no_number(given: Any) -> None:
    with pytest.raises(TypeError, match=r"^gap must be a number, not "):
        arguments.number("gap", given)


@pytest.mark.parametrize("given", ["12", b"12", 3, {0: 1}, None])
def test_texts_and_numbers_are_no_lists_of_integers(given: Any) -> None:
    """The bytes of a text were taken as integers before."""
    with pytest.raises(TypeError, match=r"^dofs must be integers in a list or array, not "):
        arguments.integers("dofs", given)


def test_an_entry_is_named_by_its_place() -> None:
    with pytest.raises(ValueError, match=r"^dofs\[1\] must be an integer, not 0.5"):
        arguments.integers("dofs", [1, 0.5])
    assert arguments.integers("dofs", range(3)) == [0, 1, 2]
    assert arguments.integers("dofs", np.arange(3)) == [0, 1, 2]


def test_rows_of_different_length() -> None:
    with pytest.raises(ValueError, match="the rows of phases differ in length"):
        arguments.rows("phases", [[1, 2], [3]])


@pytest.mark.parametrize("given", ["x", ["1", "2"], [b"1"], [{}], [None, "x"], [10**400]])
def test_arrays_of_something_else(given: Any) -> None:
    with pytest.raises(TypeError, match=r"^tau must be numbers, not "):
        arguments.numbers("tau", given)


def test_long_values_are_cut_in_errors() -> None:
    with pytest.raises(TypeError) as failure:
        arguments.number("gap", list(range(1000)))
    assert len(str(failure.value)) < 100


@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("gap", lambda wrong: vi.constraint(0, wrong)),
        ("dof", lambda wrong: vi.constraint(wrong, 0.1)),
        ("a direction", lambda wrong: vi.constraint(None, 0.1, direction=wrong)),
        ("n", lambda wrong: vi.chain(wrong, [])),
        ("mass", lambda wrong: vi.chain(2, [], wrong)),
        ("amplitude", lambda wrong: vi.drive(0, wrong)),
        ("harmonic", lambda wrong: vi.drive(0, 1.0, wrong)),
        ("count", lambda wrong: REQUESTS.natural_frequencies(CHAIN, wrong)),
        ("frequency", lambda wrong: REQUESTS.impact_modes(CHAIN, wrong)),
        ("load", lambda wrong: REQUESTS.periodic_motions(CHAIN, [1.0], wrong)),
        ("the range", lambda wrong: REQUESTS.existence_bands(CHAIN, wrong)),
        ("t_end", lambda wrong: REQUESTS.time_history(CHAIN, 1.2, wrong)),
        ("initial", lambda wrong: REQUESTS.time_history(CHAIN, wrong, 1.0)),
        ("x", lambda wrong: REQUESTS.ensemble(CHAIN, wrong, [[0, 1, 0]], 1.0)),
    ],
)
def test_functions_name_the_argument(name: str, call: Callable[[Any], Any]) -> None:
    with pytest.raises(TypeError, match=f"^{name} "):
        call("wrong")
