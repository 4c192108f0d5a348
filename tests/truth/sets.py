"""The sets of random cases: how one is made, and how it is checked."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from tests.truth import bands, digits, histories, members, soft
from tests.truth.verdicts import Case, Report

SETS: Final[dict[str, tuple[Callable[[np.random.Generator], Case], Callable[[Case, Report], None]]]]
SETS = {
    "members": (members.case, members.check),
    "bands": (bands.case, bands.check),
    "histories": (histories.case, histories.check),
    "digits": (digits.case, digits.check),
    "soft": (soft.case, soft.check),
}

USUAL: Final = {
    "members": 30_000,
    "bands": 20_000,
    "histories": 20_000,
    "digits": 1_000,
    "soft": 1_000,
}
