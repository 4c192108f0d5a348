"""A reduced model beside the whole one, at its stops: harmonic, static, and in one motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from vibroimpact import grids
from vibroimpact.models import motion_comparison
from vibroimpact.models.flexibility import Flexibility
from vibroimpact.models.motion_comparison import MotionComparison
from vibroimpact.models.static_solvers import flexibilities
from vibroimpact.models.whole_response import responses, subspace
from vibroimpact.models.whole_system import Side
from vibroimpact.tables import Array, html_table

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from vibroimpact import documents
    from vibroimpact.client import Client
    from vibroimpact.local import Local

_HARMONICS: Final = 64
"""Harmonics of a drive whose responses are sought at most."""
_RESIDUAL: Final = 1e-4
"""Residuals above it are said."""


@dataclass(frozen=True, eq=False, repr=False)
class Comparison:
    """What a reduced model leaves out, at its stops, by the same of the whole model.

    Parameters
    ----------
    Omega : array, shape (frequency,)
        Angular frequencies.
    receptance, whole_receptance : array, shape (frequency, stop, force), complex
        Displacements at the stops by unit forces: of the reduced model, of the whole.
    flexibility, whole_flexibility : array, shape (stop, force)
        Static displacements; of a structure that floats freely, the elastic ones, while the inertia
        of its rigid bodies carries the force.
    residual : array, shape (frequency,)
        Largest residual of the whole model's responses: they are those of a model whose dynamic
        stiffness differs by this part, see `vibroimpact.models.whole_response`.
    forces : sequence of str
        ``"stop 0"``, one for each stop, and ``"load 0"``, one for each term of the load.
    unit : str
        Of frequencies in pictures: Omega, Hz or rpm.
    time : str
        Unit of time of the structure.
    of : (int, int)
        Degrees of freedom of the reduced and of the whole model.
    motion : MotionComparison or None
        Of the driven motions at one frequency, if one was asked for.
    """

    Omega: Array
    receptance: Array
    whole_receptance: Array
    flexibility: Array
    whole_flexibility: Array
    residual: Array
    forces: Sequence[str]
    unit: str
    time: str
    of: tuple[int, int]
    motion: MotionComparison | None = None

    @property
    def error(self) -> Array:
        """Differences of receptances, of the largest over all frequencies: like `receptance`."""
        return _part(self.receptance - self.whole_receptance, self.whole_receptance)

    @property
    def flexibility_error(self) -> Array:
        """Differences of flexibilities, of the largest at each force, shape (stop, force)."""
        return _part(self.flexibility - self.whole_flexibility, self.whole_flexibility)

    def __repr__(self) -> str:
        """Return the sentence about it."""
        return f"<Comparison: {self}>"

    def __str__(self) -> str:
        """Return the largest differences."""
        frequencies, unit = self._frequencies()
        error = self.error
        where = f"{frequencies.min():.4g} to {frequencies.max():.4g} {unit}".rstrip()
        parts = [
            f"{self.of[0]} for {self.of[1]} degrees of freedom",
            f"receptances at the stops from {where} differ by up to {_percent(error.max())} of "
            f"their largest, {_percent(float(np.median(error.max(axis=(1, 2)))))} in the median",
            f"flexibilities by {_percent(self.flexibility_error.max())}",
        ]
        if self.residual.max() > _RESIDUAL:
            parts.append(f"the whole model's responses have residuals of {self.residual.max():.1g}")
        return "; ".join(parts + ([] if self.motion is None else [str(self.motion)]))

    def _repr_html_(self) -> str:
        frequencies, unit = self._frequencies()
        error = self.error
        rows = [
            [f"stop {stop}", force, _percent(error[:, stop, column].max()),
             f"{frequencies[error[:, stop, column].argmax()]:.5g}",
             _percent(self.flexibility_error[stop, column])]
            for stop in range(error.shape[1]) for column, force in enumerate(self.forces)
        ]  # fmt: skip
        at = f"at {unit}".rstrip()
        head = ["at", "force at", "receptance differs by up to", at, "flexibility differs by"]
        motion = "" if self.motion is None else f"<p>{self.motion}</p>"
        return f"<b>Comparison</b> {self.of[0]} for {self.of[1]} degrees of freedom" + (
            f"{html_table(head, rows)}{motion}"
        )

    def plot(self, ax: Axes | None = None, *, stop: int = 0, force: int | str = 0) -> Axes:
        """Plot a receptance of both models over the frequency.

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw in; default: those of a new figure.
        stop : int
            Where the displacement is.
        force : int or str
            Which force, of `forces`.
        """
        from vibroimpact.style import ADMISSIBLE, PHANTOM, legend, new_axes

        ax = ax or new_axes()
        column = self.forces.index(force) if isinstance(force, str) else force
        frequencies, unit = self._frequencies()
        for values, name, color, style in (
            (self.whole_receptance, f"whole model, {self.of[1]} degrees of freedom", PHANTOM, "-"),
            (self.receptance, f"reduced, {self.of[0]}", ADMISSIBLE, (0, (5, 1.5))),
        ):
            line = np.abs(values[:, stop, column])
            ax.semilogy(frequencies, line, color=color, linestyle=style, label=name)
        ax.set_xlabel(f"frequency ({unit})" if unit else r"frequency $\Omega$")
        ax.set_ylabel(f"receptance, stop {stop} by {self.forces[column]}")
        legend(ax)
        return ax

    def _frequencies(self) -> tuple[Array, str]:
        """Return the frequencies in the unit of pictures, and its name."""
        name = {"Hz": "Hz", "rpm": "1/min"}.get(self.unit, f"rad/{self.time}" if self.time else "")
        return self.Omega / grids.angular(self.unit, self.time or "s"), name


def _percent(part: float) -> str:
    return f"{100.0 * part:.2g} %"


def _part(difference: Array, whole: Array) -> Array:
    """Return differences relative to the largest along the first axis."""
    size = np.abs(whole).max(axis=0, keepdims=True)
    return np.abs(difference) / np.where(size > 0.0, size, np.inf)


def compared(
    side: Side,
    first: int,
    motions: Array,
    frequency: Array,
    load: Sequence[documents.DriveTerm],
    unit: str,
    at: float | None,
    client: Client | Local | None,
    options: Mapping[str, Any],
) -> Comparison:
    """Compare a reduced model with the whole, see `Reduction.compare`.

    Parameters
    ----------
    side : Side
        Both models, and the structure.
    first : int
        Columns of T before the elastic modes.
    motions : array, shape (reduced dof, rigid)
        Motions of rigid bodies.
    frequency : array
        Frequencies in `unit`; likewise `at`.
    load, unit, at, client, options
        As of `Reduction.compare`.
    """
    units = side.structure.get("units") or {}
    factor = grids.angular(unit, units.get("time", "s"))
    Omega = factor * frequency
    if not Omega.size or not np.isfinite(Omega).all() or Omega.min() <= 0.0:
        raise ValueError("frequency: give positive numbers; the static response is compared too")
    if at is not None:
        motion_comparison.check(side)
    stops, T, whole, small = side.stops, side.T, side.whole, side.small
    F = np.hstack([stops, side.loads(load)])
    everything, flexible = flexibilities(whole, side.rows, T @ motions, _bodies(side, first))
    alike = Omega
    if at is not None:  # and the harmonics of the drive
        count = min(_HARMONICS, max(1, int(Omega.max() / (factor * at))))
        alike = np.append(Omega, factor * at * np.arange(1, 1 + count))
    space = subspace(side, flexible, first, F, alike)
    elastic = Flexibility(small.K, small.M, motions).elastic(T.T @ F)
    C, M, K = (0.5 * (part + part.T) for part in _small(side))
    lacking = np.zeros((stops.shape[1], F.shape[1]))
    given = side.structure.get("residual_flexibility")
    if given is not None:
        lacking[:, : stops.shape[1]] = given
    motion = None
    if at is not None:
        motion = motion_comparison.compare(side, space, first, load, unit, at, client, options)
    return Comparison(
        Omega,
        (stops.T @ T) @ responses(M, C, K, T.T @ F, Omega) + lacking,
        (stops.T @ space.V) @ space.x[: Omega.size],
        stops.T @ (T @ elastic) + lacking,
        stops.T @ everything.elastic(F),
        space.residual[: Omega.size],
        [f"{name} {place}" for name, count in (("stop", stops.shape[1]), ("load", len(load)))
         for place in range(count)],
        unit,
        units.get("time", ""),
        (small.n, whole.n),
        motion,
    )  # fmt: skip


def _bodies(side: Side, first: int) -> Array:
    """Return the motions of rigid bodies that leave the kept ones at rest, of the others."""
    others = np.setdiff1d(np.arange(side.whole.n), side.rows)
    bodies: Array = side.T[others, side.rows.size : first]
    return bodies


def _small(side: Side) -> tuple[Array, Array, Array]:
    """Return C, M and K of the reduced model."""
    T, small = side.T, side.small
    return T.T @ side.damped(T), small.M.toarray(), small.K.toarray()
