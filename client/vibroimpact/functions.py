"""A computation as a function of some numbers of its request, with its Jacobian, for optimisers."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np

from vibroimpact.arguments import names
from vibroimpact.derivatives import place_of
from vibroimpact.local import Local
from vibroimpact.plain import plain

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from vibroimpact import documents
    from vibroimpact.results import Result
    from vibroimpact.tables import Array

    Compute = Callable[[documents.Kind, Mapping[str, Any]], Result]

_FACTOR: Final = ("M", "K", "C")


class Function:
    """Outputs of a computation by numbers of its request: ``f(x)`` and ``f.jacobian(x)``.

    The last point that was computed is kept with its Jacobian, which comes with the values: an
    optimiser that asks for both at one point pays for one computation.

    Parameters
    ----------
    kind : str
        Kind of computation that has derivatives: ``"impact-modes"``, ``"natural-frequencies"``,
        ``"time-history"``.
    request : mapping
        The request document; its numbers at `inputs` are where optimisers start, see `start`.
    inputs : sequence of str
        Paths of these numbers, as in ``derivatives``. A factor of a matrix, such as
        ``"system.K.scale"``, is 1 in the request.
    outputs : sequence of str
        Names of the outputs, such as ``"momentum"`` or ``"impacts.time"``, all of whose numbers
        follow one another.
    compute : callable, optional
        Computes a request of a kind, such as ``client.compute``; default: ``Local().compute``.

    Examples
    --------
    >>> request = impact_modes_request(system, [20.0], outputs=["impulse"])  # doctest: +SKIP
    >>> f = function("impact-modes", request, ["system.constraints.0.gap"], ["momentum"])
    ... # doctest: +SKIP
    >>> scipy.optimize.least_squares(lambda x: f(x) - measured, f.start,
    ...                              jac=f.jacobian)  # doctest: +SKIP
    """

    def __init__(
        self,
        kind: documents.Kind,
        request: Mapping[str, Any],
        inputs: Sequence[str],
        outputs: Sequence[str],
        *,
        compute: Compute | None = None,
    ) -> None:
        self.kind, self.inputs, self.outputs = kind, tuple(names(inputs)), tuple(names(outputs))
        if not self.inputs or not self.outputs:
            raise ValueError("a function needs inputs and outputs")
        if len(set(self.inputs)) != len(self.inputs):
            raise ValueError("an input is given twice")
        self._request: dict[str, Any] = copy.deepcopy(dict(plain(request)))
        self._request["derivatives"] = list(self.inputs)
        self._compute = cast("Compute", Local().compute if compute is None else compute)
        self._last: tuple[bytes, Result] | None = None
        self.start = np.array([_number(self._request, path) for path in self.inputs])
        """The numbers of the request, shape (input,)."""

    def result(self, x: ArrayLike) -> Result:
        """Return the whole result at a point, shape (input,)."""
        point = np.ascontiguousarray(x, dtype=np.float64)
        if point.shape != self.start.shape:
            raise ValueError(f"the point has shape {point.shape}, not {self.start.shape}")
        if self._last is None or self._last[0] != point.tobytes():
            self._last = point.tobytes(), self._compute(self.kind, self._at(point))
        return self._last[1]

    def __call__(self, x: ArrayLike) -> Array:
        """Return the outputs at a point, one after another, shape (number,)."""
        result = self.result(x)
        return np.concatenate([np.ravel(attrgetter(name)(result)) for name in self.outputs])

    def jacobian(self, x: ArrayLike) -> Array:
        """Return the derivatives of the outputs at a point, shape (number, input).

        Numbers without a derivative are nan; ``f.result(x).derivative["reason"]`` tells why.
        """
        derivatives = self.result(x).derivative
        paths = [str(path) for path in derivatives["parameter"]]
        order = [place_of(path, paths) for path in self.inputs]
        columns = []
        for name in self.outputs:
            values = derivatives.by_all(name)
            columns.append(values.reshape(-1, values.shape[-1])[:, order])
        return np.concatenate(columns) * self._weights(np.asarray(x, dtype=np.float64))

    def _weights(self, point: Array) -> Array:
        """Return by what derivatives by numbers as they are sent are those by the inputs."""
        weights = np.ones(point.size)
        for k, path in enumerate(self.inputs):
            if not _is_factor(path.split(".")):
                continue
            # The matrix that is sent is the factor times the one of the inputs.
            if point[k] == 0.0:
                raise ValueError(f"{path} is 0, where there is no derivative")
            weights[k] /= point[k]
            for other, entry in enumerate(self.inputs):
                if other != k and entry.startswith(path.removesuffix("scale")):
                    weights[other] *= point[k]
        return weights

    def _at(self, point: Array) -> dict[str, Any]:
        """Return the request with other numbers."""
        request = copy.deepcopy(self._request)
        given = list(zip(self.inputs, point.tolist(), strict=True))
        # Factors multiply the other numbers, whatever the order of the inputs is.
        for path, value in sorted(given, key=lambda pair: _is_factor(pair[0].split("."))):
            _put(request, path, value)
        return request

    def jax(self) -> Callable[[Any], Any]:
        """Return the function for jax: differentiable in reverse, and traced as a callback.

        Raises
        ------
        ImportError
            Where jax is not installed.
        """
        jax: Any = import_module("jax")
        size = self(self.start).size

        def shape(count: int) -> Any:
            return jax.ShapeDtypeStruct((count,), jax.numpy.result_type(float))

        def numbers(x: Any) -> Any:
            return jax.pure_callback(self.__call__, shape(size), x)

        def pulled(x: Any, by: Any) -> Any:
            return jax.pure_callback(
                lambda point, weights: self.jacobian(point).T @ np.asarray(weights),
                shape(self.start.size), x, by,
            )  # fmt: skip

        wrapped = jax.custom_vjp(numbers)
        wrapped.defvjp(lambda x: (numbers(x), x), lambda x, by: (pulled(x, by),))
        return cast("Callable[[Any], Any]", wrapped)


def function(
    kind: documents.Kind,
    request: Mapping[str, Any],
    inputs: Sequence[str],
    outputs: Sequence[str],
    *,
    compute: Compute | None = None,
) -> Function:
    """Return a computation as a function of some numbers of its request, see `Function`."""
    return Function(kind, request, inputs, outputs, compute=compute)


def _is_factor(path: list[str]) -> bool:
    return len(path) == 3 and path[0] == "system" and path[1] in _FACTOR and path[2] == "scale"


def _number(request: Mapping[str, Any], path: str) -> float:
    """Return the number at a path of a request.

    Raises
    ------
    ValueError
        Where there is none.
    """
    parts = path.split(".")
    if _is_factor(parts):
        system = request.get("system")
        if not isinstance(system, Mapping) or system.get(parts[1]) is None:
            preset = isinstance(system, Mapping) and "preset" in system
            instead = ": the structure is a preset; vary its parameters instead" if preset else ""
            raise ValueError(f"{path}: the request has no matrix {parts[1]}{instead}")
        return 1.0
    try:
        value = _inner(request, parts)
    except (KeyError, IndexError, TypeError, ValueError):
        raise ValueError(f"there is no number {path!r} in the request to begin with") from None
    if isinstance(value, bool) or not isinstance(value, int | float):
        fault = f"{path!r} is no number of the request"
        raise ValueError(fault)  # noqa: TRY004 - the path is wrong, not a type
    return float(value)


def _inner(here: Any, parts: Sequence[str]) -> Any:
    for part in parts:
        here = here[int(part)] if isinstance(here, list) else here[part]
    return here


def _put(request: dict[str, Any], path: str, value: float) -> None:
    """Put a number at a path of a request; entries of matrices stay symmetric."""
    parts = path.split(".")
    if _is_factor(parts):
        request["system"][parts[1]] = _scaled(request["system"][parts[1]], value)
        return
    *outer, last = parts
    holder = _inner(request, outer)
    if isinstance(holder, list):
        holder[int(last)] = value
    else:
        holder[last] = value
    if len(parts) == 4 and parts[0] == "system" and parts[1] in _FACTOR and parts[2].isdigit():
        request["system"][parts[1]][int(last)][int(parts[2])] = value
    elif len(parts) == 4 and parts[0] == "system" and parts[2] == "data":
        _mirror(request["system"][parts[1]], int(last), value)


def _mirror(matrix: Mapping[str, Any], k: int, value: float) -> None:
    """Let the entry that is equal by symmetry have the value too."""
    i, j = matrix["row"][k], matrix["col"][k]
    for other, pair in enumerate(zip(matrix["row"], matrix["col"], strict=True)):
        if i != j and pair == (j, i):
            matrix["data"][other] = value


def _scaled(matrix: Any, factor: float) -> Any:
    """Return a matrix of a document times a number."""
    if isinstance(matrix, list):
        return [[factor * entry for entry in row] for row in matrix]
    scaled = dict(matrix)
    for name in ("diagonal", "data"):
        if name in scaled:
            scaled[name] = [factor * entry for entry in scaled[name]]
    if "bands" in scaled:
        scaled["bands"] = {k: [factor * entry for entry in v] for k, v in scaled["bands"].items()}
    if "scalar" in scaled:
        scaled["scalar"] *= factor
    return scaled
