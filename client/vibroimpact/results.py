"""The result of a computation, with its display in notebooks and its plots."""

from __future__ import annotations

import html
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from vibroimpact import plots, sweep_plots
from vibroimpact.result_file import ResultFile
from vibroimpact.tables import Array, Table, html_table

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Array", "Result", "Table"]

_NOT_OUTPUTS = frozenset({"axes", "error", "frequency"})
"""Tables that describe the outputs or their axes."""


class Result(ResultFile):
    """The result of a computation.

    Every output is an attribute: ``result.impulse``, ``result.shape``, ``result.Omega``.
    Codes are decoded: ``exists`` is boolean, ``reason`` an array of words.

    Parameters
    ----------
    content : bytes
        The HDF5 file.
    """

    def plot(
        self,
        ax: Axes | None = None,
        *,
        output: str | None = None,
        at: Mapping[str, float] | None = None,
    ) -> Axes:
        """Plot the result; what is drawn depends on its kind.

        Impact modes: the impulse over frequency, or the mode shape where there is one frequency
        only; ``output="energy"`` gives the frequency-energy plot. Periodic motions: the
        amplitude over the frequency of the drive. Time histories: a displacement
        over time. Ensembles: the number of impacts over the initial states, see
        `vibroimpact.plots.basins`. Sweeps: an output over the one or two dimensions that are
        left, see `vibroimpact.sweep_plots.draw`.

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw in; default: those of a new figure.
        output : str, optional
            Output of impact modes or of a sweep; default: the most telling one, or the first.
        at : mapping, optional
            For a sweep: dimension -> value at which it is held fixed.

        Raises
        ------
        ValueError
            If there is no plot of that output.
        """
        if self.kind == "sweep":
            return sweep_plots.draw(self, output, at, ax)
        if self.kind == "impact-modes":
            single = "shape" in self._arrays and self.Omega.size == 1
            return plots.mode_plot(output or ("shape" if single else "impulse"))(self, ax=ax)
        if output is not None:
            raise ValueError(f"{self.kind} has one plot only, so that output cannot be chosen")
        drawing: dict[str, Callable[..., Axes]] = {
            "existence-bands": plots.bands,
            "resonances": plots.resonances,
            "periodic-motions": plots.response,
            "time-history": plots.history,
            "ensemble": plots.basins,
            "slow-flow": plots.displacement,
        }
        return drawing[self.kind](self, ax=ax)

    def _output_tables(self) -> list[tuple[str, Table]]:
        return [
            (name, table)
            for name, table in self._tables.items()
            if table.rows is not None and name not in _NOT_OUTPUTS
        ]

    def __repr__(self) -> str:
        """Return the kind, the digest and the sizes of the outputs."""
        sizes = [f"{name} {array.shape}" for name, array in self._arrays.items()]
        sizes += [f"{name} ({table.rows} rows)" for name, table in self._output_tables()]
        return f"<Result {self.kind} {self.digest[:12]}: {', '.join(sizes)}>"

    def _repr_html_(self) -> str:
        rows = [[name, str(a.shape), self._long_names[name]] for name, a in self._arrays.items()]
        rows += [
            [name, f"{table.rows} rows", ", ".join(table)] for name, table in self._output_tables()
        ]
        statement = self._tables["error"].get("statement") if "error" in self._tables else None
        note = f"<p>{html.escape(str(statement))}</p>" if statement else ""
        head = f"<b>{html.escape(self.kind)}</b> <code>{self.digest[:12]}</code>"
        return f"{head}{html_table(['name', 'size', 'meaning'], rows)}{note}"
