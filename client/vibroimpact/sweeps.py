"""Request documents of sweeps, made from numbers and arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from vibroimpact.systems import Document, names, times


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
        Kind of computation, such as ``"impact-modes"``.
    base : dict
        A request of that kind, for example from `impact_modes_request`.
    axes : mapping
        Path of a number in the base -> its values, see `axis`. The axes are the first dimensions
        of the results, in this order.
    outputs : sequence of str, optional
        Quantities to compute; default: the outputs of the base.
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
    """Return the document of a sweep axis.

    Parameters
    ----------
    path : str
        Path of the number that varies, such as ``"system.constraints.0.gap"``.
    values : array, (start, stop, num) or dict
        Values of the number. Sweeps over ``start``, ``stop`` and ``step`` reuse the parts that
        longer or shifted sweeps with the same step have computed; ``name`` names the dimension.
    """
    return {"path": path} | times(values)
