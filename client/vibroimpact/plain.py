"""Documents that hold numpy arrays and numbers, as JSON has them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np


def plain(value: Any) -> Any:
    """Return a document with lists in place of its arrays.

    Lists of nothing but Python's own numbers and texts stay as they are.

    Examples
    --------
    >>> plain({"values": np.array([1.0, 2.0]), "num": np.int64(2), "dofs": [0, np.int64(3)]})
    {'values': [1.0, 2.0], 'num': 2, 'dofs': [0, 3]}
    """
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return {name: plain(each) for name, each in value.items()}
    if isinstance(value, list | tuple) and not _PLAIN.issuperset(map(type, value)):
        return [plain(each) for each in value]
    return value


_PLAIN = frozenset({int, float, str, bool, type(None)})
