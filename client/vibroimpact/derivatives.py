"""Derivatives of the outputs of a result, by the names of outputs and parameters."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from vibroimpact.tables import Table

if TYPE_CHECKING:
    from vibroimpact.tables import Array


class Derivatives(Table):
    """Derivatives of outputs, a column for each; the last axis is that of the parameters.

    ``result.derivative("momentum", "gap")`` returns those of an output by one of them.
    """

    def __call__(self, output: str, parameter: str) -> Array:
        """Return the derivatives of an output by one parameter, in the shape of the output.

        Parameters
        ----------
        output : str
            Such as ``"momentum"``, or ``"impacts.time"`` of a column of a table.
        parameter : str
            Its path, such as ``"system.constraints.0.gap"``, or an end of it that no other path
            has, such as ``"gap"``.

        Raises
        ------
        ValueError
            Where there is no such output or parameter, or more than one.
        """
        values = self.by_all(output)
        return values[..., place_of(parameter, [str(path) for path in self["parameter"]])]

    def by_all(self, output: str) -> Array:
        """Return the derivatives of an output by all parameters, which are its last axis.

        Raises
        ------
        ValueError
            Where there is no such output.
        """
        every = dict(_columns(self))
        if output not in every:
            raise ValueError(f"there is no derivative of {output!r}; there are {', '.join(every)}")
        return every[output]


def _columns(table: Table, under: str = "") -> Iterator[tuple[str, Array]]:
    """Yield the derivatives of a table and of those in it, by their names."""
    for name, column in table.items():
        if isinstance(column, Table):
            yield from _columns(column, f"{under}{name}.")
        elif name not in _ABOUT:
            yield f"{under}{name}", column


_ABOUT = frozenset({"parameter", "unit", "reason", "distance"})


def place_of(parameter: str, paths: list[str]) -> int:
    """Return the place of a parameter among paths, by its path or an end of it.

    Raises
    ------
    ValueError
        Where there is none, or more than one.
    """
    if parameter in paths:
        return paths.index(parameter)
    alike = [k for k, path in enumerate(paths) if path.endswith(f".{parameter}")]
    if len(alike) == 1:
        return alike[0]
    fault = "no parameter" if not alike else "more than one parameter"
    raise ValueError(f"there is {fault} {parameter!r}; there are {', '.join(paths)}")
