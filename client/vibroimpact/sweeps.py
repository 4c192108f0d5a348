"""Documents that ask for sweeps, made from numbers and arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vibroimpact.systems import names

Document = dict[str, Any]


def sweep_request(
    kind: str,
    base: Mapping[str, Any],
    axes: Mapping[str, Any],
    outputs: Sequence[str] | None = None,
) -> Document:
    """Return the request document that `Client.sweep` sends.

    Parameters
    ----------
    kind : str
        Of the computation, such as ``"impact-modes"``.
    base : dict
        A request of that kind, as `impact_modes_request` makes it.
    axes : mapping
        Path of a number of the base -> its values, see `axis`. Results have these axes in this
        order, before their own dimensions.
    outputs : sequence of str, optional
        What is wanted; absent: the outputs of the base.
    """
    request: Document = {
        "kind": kind,
        "base": dict(base),
        "axes": [axis(path, values) for path, values in axes.items()],
    }
    if outputs is not None:
        request["outputs"] = names(outputs)
    return request


def axis(path: str, values: Any) -> Document:
    """Return the document of an axis.

    Parameters
    ----------
    path : str
        The number of the base that varies, such as ``"system.constraints.0.gap"``.
    values : array, (start, stop, num) or dict
        Its values; a dictionary with ``start``, ``stop`` and ``step`` makes a lattice of which
        longer and shifted sweeps use the parts that were computed before; with ``name`` it
        names the dimension.
    """
    if isinstance(values, Mapping):
        return {"path": path} | dict(values)
    if isinstance(values, tuple) and len(values) == 3:
        start, stop, num = values
        return {"path": path, "start": float(start), "stop": float(stop), "num": int(num)}
    return {"path": path, "values": np.atleast_1d(np.asarray(values, np.float64)).tolist()}
