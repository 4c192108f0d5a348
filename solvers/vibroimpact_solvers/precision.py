"""Precision of ball arithmetic, the numbers of FLINT: each is a number and a bound of its error.

It is a setting of the process, so that one computation runs at a time.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import flint

_ONE_AT_A_TIME = threading.Lock()


@contextmanager
def working(bits: int) -> Iterator[None]:
    """Compute with so many bits."""
    with _ONE_AT_A_TIME:
        before = flint.ctx.prec
        flint.ctx.prec = bits
        try:
            yield
        finally:
            flint.ctx.prec = before
