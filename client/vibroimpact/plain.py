"""Documents that hold numpy arrays and numbers, as JSON has them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np


def plain(value: Any) -> Any:
    """Return a document with lists in place of its arrays.

    Lists are searched where they begin with a document or an array: long ones of numbers are not.

    Examples
    --------
    >>> plain({"values": np.array([1.0, 2.0]), "num": np.int64(2)})
    {'values': [1.0, 2.0], 'num': 2}
    """
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return {name: plain(each) for name, each in value.items()}
    if isinstance(value, list | tuple) and value and isinstance(value[0], _SEARCHED):
        return [plain(each) for each in value]
    return value


_SEARCHED = (Mapping, list, tuple, np.ndarray, np.generic)
