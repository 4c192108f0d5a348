"""The result of a computation, with its display in notebooks and its plots."""

from __future__ import annotations

import html
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from vibroimpact import calibration_plots, natural_modes, notebook, plots, sweep_plots
from vibroimpact.result_file import ResultFile
from vibroimpact.summary import summary
from vibroimpact.tables import Array, Table, html_table

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from vibroimpact.sensitivity import Sensitivity

__all__ = ["Array", "Result", "Table"]

_AMBER = "border-left: 4px solid #c77700; padding-left: .6em; margin: .4em 0"
"""Style of a caution; the text keeps the colour of the notebook, light or dark."""


class Result(ResultFile):
    """The result of a computation.

    Every output is an attribute: ``result.impulse``, ``result.shape``, ``result.Omega``.
    Codes are decoded: ``exists`` is boolean, ``reason`` an array of words.

    Parameters
    ----------
    content : bytes or path
        The HDF5 file, or where it lies; a file on disk is read part by part as it is used.
    """

    sensitivity: Sensitivity | None = None
    """How much the result changes where half of the modes of a reduced model are left out, see
    `Reduction.compute`; None: it is not known.
    """

    def plot(
        self,
        ax: Axes | None = None,
        *,
        output: str | None = None,
        at: Mapping[str, float] | None = None,
    ) -> Axes:
        """Plot the result; what is drawn depends on its kind.

        Natural frequencies: the lowest mode shapes, or the frequencies with ``output="Omega"``.
        Impact modes: the momentum of the impacts over frequency, or the mode shape where there is
        one frequency only, or else what was computed; ``output="energy"`` gives the
        frequency-energy plot. Periodic motions: the
        amplitude over the frequency of the drive. Attractors: their Poincaré sections; of a sweep,
        a bifurcation diagram. Time histories: a displacement
        over time. Ensembles: the number of impacts over the initial states, see
        `vibroimpact.plots.basins`. Sweeps: an output over the one or two dimensions that are
        left, see `vibroimpact.sweep_plots.draw`.

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw in; default: those of a new figure.
        output : str, optional
            Output of impact modes, natural frequencies, a calibration or a sweep; default: the
            most telling one, or the first.
        at : mapping, optional
            For a sweep: dimension -> value at which it is held fixed.

        Raises
        ------
        ValueError
            If there is no plot of that output.
        TypeError
            If `ax` is a text.
        """
        if isinstance(ax, str):
            raise TypeError(f"ax must be axes, not {ax!r}; write plot(output={ax!r})")
        if self.kind == "sweep":
            if output is None and at is None and "section_count" in self:
                return plots.bifurcation(self, ax=ax)
            return sweep_plots.draw(self, output, at, ax)
        if self.kind == "impact-modes":
            return plots.mode_plot(output or self._most_telling())(self, ax=ax)
        if self.kind == "natural-frequencies":
            return natural_modes.plot_of(output)(self, ax=ax)
        if self.kind == "calibration":
            return calibration_plots.plot_of(output, self, ax)
        if output is not None:
            raise ValueError(f"{self.kind} has one plot only, so that output cannot be chosen")
        drawing: dict[str, Callable[..., Axes]] = {
            "existence-bands": plots.bands,
            "resonances": plots.resonances,
            "periodic-motions": plots.response,
            "attractors": plots.section,
            "branches": plots.branches,
            "time-history": plots.history,
            "ensemble": plots.basins,
            "slow-flow": plots.displacement,
        }
        return drawing[self.kind](self, ax=ax)

    def _most_telling(self) -> str:
        """Return the output of impact modes that a plot without a choice shows."""
        single = ("shape", "waveform", "harmonics") if self.Omega.size == 1 else ()
        order = (*single, "impulse", "energy", "stability", "exists", "reason", "shape", "waveform")
        output = next((name for name in order if name in self._arrays), "harmonics")
        return "momentum" if output == "impulse" else output

    def show(self) -> Any:
        """Return a widget for notebooks in which the structure moves between its stops.

        Impact modes and periodic motions need the output waveform, time histories x; see
        `vibroimpact.notebook`. It comes with ``pip install "vibroimpact[notebook]"``.

        Raises
        ------
        ValueError
            If the result has no displacements over time.
        ImportError
            If anywidget is not installed.
        """
        return notebook.show(self)

    def __repr__(self) -> str:
        """Return the kind, the digest and the sizes of the outputs; natural frequencies follow."""
        sizes = [f"{name} {self._about[name].shape}" for name in self._arrays]
        sizes += [f"{name} ({rows} rows)" for name, rows in self.row_counts().items()]
        more = [
            *self.neglected,
            *self.cautions,
            *([] if self.sensitivity is None else [str(self.sensitivity)]),
        ]
        said = "".join(f"; {sentence}" for sentence in more)
        text = f"<Result {self.kind} {self.digest[:12]}: {', '.join(sizes)}{said}>"
        if self.kind == "natural-frequencies":
            return f"{text}\n{natural_modes.table(self)}"
        return text

    def __str__(self) -> str:
        """Return a line for each output: its range, and the largest of its errors."""
        text = summary(self)
        if self.sensitivity is not None:
            text += f"\n  {self.sensitivity}"
        return (
            f"{text}\n{natural_modes.table(self)}" if self.kind == "natural-frequencies" else text
        )

    def _repr_html_(self) -> str:
        told = [(name, self._about[name]) for name in self._arrays]
        rows = [[name, str(about.shape), about.long_name] for name, about in told]
        rows += [
            [name, f"{count} rows", ", ".join(self._tables[name])]
            for name, count in self.row_counts().items()
        ]
        statement = self._tables["error"].get("statement") if "error" in self._tables else None
        note = f"<p>{html.escape(str(statement))}</p>" if statement else ""
        if self.sensitivity is not None:
            note += f"<p>{html.escape(str(self.sensitivity))}</p>"
        head = f"<b>{html.escape(self.kind)}</b> <code>{self.digest[:12]}</code>"
        head += "".join(
            f"<p style='{_AMBER}'>{html.escape(each[:1].upper() + each[1:])}.</p>"
            for each in (*self.neglected, *self.cautions)
        )
        if self.kind == "natural-frequencies":
            head += html_table(*natural_modes.rows(self))
        return f"{head}{html_table(['name', 'size', 'meaning'], rows)}{note}"
