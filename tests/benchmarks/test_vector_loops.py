"""The hottest kernel stays a lean vector loop: instructions are counted, not times.

Timed guards miss what hides in the noise of a shared machine; what the compiler makes of a loop
does not vary.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

import numba
import numpy as np
import pytest

from vibroimpact_solvers.kernels import response

# As LLVM 20 compiles it for 512 bit vectors; 53 for those of 256 bit, whose loop it unrolls less.
INSTRUCTIONS_PER_TANGENT = 49
MARGIN = 1.4


def blocks(code: str) -> Iterator[list[str]]:
    """Yield the basic blocks of functions in LLVM's language."""
    block: list[str] = []
    for line in code.splitlines():
        text = line.strip()
        if re.match(r"^[\w.]+:", text) or text.startswith(("define", "}")):
            yield block
            block = []
        elif text and not text.startswith(";"):
            block.append(text)
    yield block


@pytest.fixture(scope="module")
def hot_block() -> list[str]:
    plain = response._sum_stable.py_func  # type: ignore[attr-defined]
    compiled = numba.njit(nogil=True, error_model="numpy")(plain)
    stable, lanes = response._Stable(*np.ones((6, 10))), response._Lanes(*np.ones((5, 64)))
    compiled(stable, lanes, np.ones(64))
    (code,) = compiled.inspect_llvm().values()
    found = [block for block in blocks(code) if any("fdiv <" in line for line in block)]
    assert found, "no division of vectors: the loop over frequencies is not a vector loop"
    return max(found, key=len)


def test_several_frequencies_at_a_time(hot_block: list[str]) -> None:
    widths = [int(n) for line in hot_block for n in re.findall(r"fdiv <(\d+) x double>", line)]
    assert min(widths) >= 2


def test_instructions_of_a_tangent(hot_block: list[str]) -> None:
    """A loop with half as many again fails."""
    divisions = sum("fdiv <" in line for line in hot_block)
    assert len(hot_block) / divisions <= MARGIN * INSTRUCTIONS_PER_TANGENT


def test_nothing_is_called_in_the_loop(hot_block: list[str]) -> None:
    calls = [line for line in hot_block if re.search(r"\bcall\b", line)]
    assert [line for line in calls if "@llvm." not in line] == []
