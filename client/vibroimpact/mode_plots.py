"""Plots of impact modes, of their bands and of resonances."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from vibroimpact.motion_plots import constraints_of, coordinate_of
from vibroimpact.result_file import ResultFile
from vibroimpact.style import (
    ADMISSIBLE,
    GREEN,
    ORANGE,
    PHANTOM,
    SERIES,
    WALL,
    frequencies,
    label,
    legend,
    new_axes,
    noted,
    title,
)
from vibroimpact.tables import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@noted
def momentum(result: ResultFile, ax: Axes | None = None) -> Axes:
    """Plot the momentum of each impact, 2 p/omega, over the frequency.

    Admissible solutions in colour, phantoms grey, poles left open.
    """
    values = 2.0 / result.omega[:, np.newaxis] * result.impulse
    text = label("momentum per impact", result, "momentum")
    return _over_frequency(result, values, text, ax)


@noted
def impulse(result: ResultFile, ax: Axes | None = None) -> Axes:
    """Plot the impulse parameter p over the frequency, as `momentum` does."""
    text = label(r"impulse parameter $p$", result, "impulse")
    return _over_frequency(result, result.impulse, text, ax)


def _admissible(result: ResultFile, otherwise: Array) -> Array:
    """Return which solutions are admissible, as exists or reason say; without them, a guess."""
    if hasattr(result, "exists"):
        exists: Array = result.exists
        return exists
    return np.asarray(result.reason == "ok") if hasattr(result, "reason") else otherwise


def _over_frequency(result: ResultFile, values: Array, text: str, ax: Axes | None) -> Axes:
    ax = ax or new_axes()
    order = np.argsort(result.Omega, kind="stable")
    x, x_label = frequencies(result, result.Omega[order])
    exists = _admissible(result, np.all(values > 0, axis=1))
    ax.axhline(0.0, color="black", linewidth=0.5)
    for column, index in enumerate(result.constraint):
        # Later curves are narrower, so that equal ones show each other.
        color, style = SERIES[column % len(SERIES)]
        width = 2.0 / (1.0 + 0.35 * column)
        curve = _broken(values[order, column])
        ax.plot(x, curve, color=PHANTOM, linewidth=0.5 * width, linestyle=style, zorder=2)
        several = values.shape[1] > 1
        shown = np.where(exists[order], curve, np.nan)
        each = f"constraint {index}" if several else "admissible"
        mark = "." if x.size < 3 else None
        ax.plot(
            x,
            shown,
            linestyle=style,
            marker=mark,
            color=color,
            linewidth=width,
            label=each,
            zorder=3,
        )
    positive = values[exists] if exists.any() else np.abs(values)
    top = 1.15 * float(np.quantile(positive, 0.97)) if positive.size else 1.0
    ax.set_ylim(-0.35 * top, top)
    ax.set_xlabel(x_label)
    ax.set_ylabel(text)
    if not exists.all():
        ax.plot([], [], color=PHANTOM, linewidth=1.0, label="phantom")
    legend(ax)
    return ax


@noted
def frequency_energy(result: ResultFile, ax: Axes | None = None) -> Axes:
    """Plot the frequency over the energy of the admissible solutions, unstable ones dotted.

    Neutral are those from which deviations do not grow; nor do they decay, as nothing is lost.
    Requires the output energy; uses exists or reason, and stability, if they were computed.
    """
    ax = ax or new_axes()
    order = np.argsort(result.Omega, kind="stable")
    Omega, energy = result.Omega[order], result.energy[order]
    frequency, text = frequencies(result, Omega)
    admissible = _admissible(result, np.isfinite(result.energy))[order]
    if hasattr(result, "stability"):
        # Results of 0.2.0 do not tell which are neutral: moduli are 1 but for rounding.
        near = result.neutral == "yes" if "neutral" in result else result.stability <= 1.0 + 1e-6
        known = near | np.isfinite(result.stability + result.error.stability)
        branches = [
            (admissible & near[order], "-", ADMISSIBLE, "neutral"),
            (admissible & (known & ~near)[order], ":", ORANGE, "unstable"),
            (admissible & ~known[order], "--", PHANTOM, "stability not known"),
        ]
    else:
        branches = [(admissible, "-", ADMISSIBLE, "impact modes")]
    for some, style, color, name in branches:
        if some.any():
            drawn = np.where(some, energy, np.nan)
            # A solution between two phantoms is a single point, which a line does not show.
            mark = "." if Omega.size < 200 else None
            ax.plot(
                drawn, frequency, style, marker=mark, markersize=3, color=color, linewidth=1.5,
                label=name,
            )  # fmt: skip
    ax.set_xscale("log")
    ax.set_xlabel(label("energy", result, "energy"))
    ax.set_ylabel(text)
    legend(ax)
    return ax


def mode_plot(output: str) -> Callable[..., Axes]:
    """Return the function that plots an output of impact modes.

    Raises
    ------
    ValueError
        If there is none.
    """
    drawing: dict[str, Callable[..., Axes]] = {
        "momentum": momentum,
        "impulse": impulse,
        "energy": frequency_energy,
        "stability": stability,
        "exists": existence,
        "reason": existence,
        "shape": shape,
        "waveform": waveform,
        "harmonics": harmonics,
    }
    if output not in drawing:
        raise ValueError(f"impact modes: {', '.join(drawing)} can be drawn, not {output!r}")
    return drawing[output]


@noted
def stability(result: ResultFile, ax: Axes | None = None) -> Axes:
    """Plot the growth of the fastest disturbance per half period over the frequency."""
    ax = ax or new_axes()
    order = np.argsort(result.Omega, kind="stable")
    x, text = frequencies(result, result.Omega[order])
    ax.axhline(1.0, color="black", linewidth=0.5)
    ax.plot(x, result.stability[order], ".-", color=ADMISSIBLE, markersize=2.5, linewidth=1.0)
    ax.set_yscale("log")
    ax.set_xlabel(text)
    ax.set_ylabel("growth per half period")
    return ax


@noted
def existence(result: ResultFile, ax: Axes | None = None) -> Axes:
    """Plot whether the solution at each frequency is admissible, and if not, why."""
    ax = ax or new_axes()
    if hasattr(result, "reason"):
        words = np.asarray(result.reason)
    else:
        words = np.where(result.exists, "ok", "phantom")
    x, text = frequencies(result, result.Omega)
    rows = sorted(set(words.tolist()), key=lambda word: (word != "ok", word))
    for place, word in enumerate(rows):
        color = ADMISSIBLE if word == "ok" else PHANTOM
        mine = words == word
        ax.plot(x[mine], np.full(mine.sum(), place), "|", color=color, markersize=9)
    names = ["admissible" if word == "ok" else str(word).replace("_", " ") for word in rows]
    ax.set_yticks(range(len(rows)), names)
    ax.set_ylim(len(rows) - 0.4, -0.6)
    ax.set_xlabel(text)
    return ax


@noted
def bands(result: ResultFile, ax: Axes | None = None) -> Axes:
    """Plot the bands that are admissible, rejected despite positive impulses, and stable."""
    ax = ax or new_axes()
    rows = [
        ("bands", "admissible", ADMISSIBLE, None, ""),
        ("rejected", "rejected", PHANTOM, None, "////"),
        ("stability", "stable", GREEN, True, ""),
        ("stability", "unstable", ORANGE, False, "...."),
    ]
    shown = [row for row in rows if hasattr(result, row[0])]
    text = ""
    for place, (name, _, color, stable, hatch) in enumerate(reversed(shown)):
        table = getattr(result, name)
        some = np.ones(table.start.size, dtype=bool)
        if stable is not None:
            some = (table.stable == "yes") == stable
        start, text = frequencies(result, table.start[some])
        stop, _ = frequencies(result, table.stop[some])
        ax.broken_barh(
            list(zip(start, stop - start, strict=True)), (place - 0.35, 0.7), facecolors=color,
            edgecolor="white" if hatch else color, hatch=hatch, linewidth=0.3,
        )  # fmt: skip
    ax.set_yticks(range(len(shown)), [name for _, name, *_ in reversed(shown)])
    ax.set_xlabel(text)
    ax.margins(x=0.0)
    return ax


@noted
def resonances(result: ResultFile, ax: Axes | None = None) -> Axes:
    """Plot the resonance frequencies, one row per harmonic, coloured by part of the structure."""
    ax = ax or new_axes()
    marks = ("|", "x", "+", "1", "2")
    for place, part in enumerate(np.unique(result.part)):
        mine, color = result.part == part, SERIES[place % len(SERIES)][0]
        ax.plot(
            result.Omega[mine], result.harmonic[mine], marks[place % len(marks)], color=color,
            markersize=7, label=f"part {part}",
        )  # fmt: skip
    ax.set_yticks(np.unique(result.harmonic))
    ax.set_xlabel(label(r"fundamental frequency $\Omega$", result, "Omega"))
    ax.set_ylabel("resonating harmonic")
    legend(ax)
    return ax


@noted
def shape(result: ResultFile, index: int = 0, ax: Axes | None = None) -> Axes:
    """Plot the displacement of every computed degree of freedom at tau = 1."""
    ax = ax or new_axes()
    x = result.shape[index]
    ax.axhline(0.0, color="black", linewidth=0.5)
    ax.plot(result.dof, x, "-", color=ADMISSIBLE, linewidth=1.0)
    if result.dof.size <= 100:
        ax.plot(result.dof, x, "o", color=ADMISSIBLE, markersize=4)
    for dof in {c["dof"] for c in constraints_of(result) if c.get("dof") is not None}:
        ax.hlines(coordinate_of(result, dof).walls, dof - 0.4, dof + 0.4, color=WALL, linewidth=2.0)
    ax.set_xlabel("degree of freedom")
    ax.set_ylabel(label(r"displacement at $\tau = 1$", result, "shape"))
    title(ax, _at(result, index))
    ax.set_xticks(result.dof if result.dof.size <= 15 else ax.get_xticks())
    return ax


@noted
def waveform(result: ResultFile, index: int = 0, ax: Axes | None = None) -> Axes:
    """Plot the displacements of one impact mode over triangle-wave time, up to five of them."""
    ax = ax or new_axes()
    order = np.argsort(result.tau)
    several = result.tau.size > 1
    chosen = _telling(result)
    for (color, style), dof in zip(SERIES, chosen, strict=False):
        column = int(np.flatnonzero(result.dof == dof)[0])
        ax.plot(
            result.tau[order], result.waveform[index][order, column], color=color,
            linestyle=style if several else "", marker=None if several else "o",
            linewidth=1.3, label=f"$x_{{{dof}}}$",
        )  # fmt: skip
    ax.locator_params(axis="x", nbins=5)
    ax.set_xlabel(r"triangle-wave time $\tau$")
    ax.set_ylabel(label("displacement", result, "waveform"))
    legend(ax, 5, title=_at(result, index), title_fontsize=7.5)
    return ax


@noted
def harmonics(result: ResultFile, index: int = 0, ax: Axes | None = None) -> Axes:
    """Plot the sizes of the Fourier amplitudes of one impact mode over their multiples of Omega."""
    ax = ax or new_axes()
    chosen = _telling(result)
    for place, ((color, _), dof) in enumerate(zip(SERIES, chosen, strict=False)):
        column = int(np.flatnonzero(result.dof == dof)[0])
        aside = result.harmonic + 0.18 * (place - 0.5 * (min(len(chosen), len(SERIES)) - 1))
        sizes = np.abs(result.harmonics[index][:, column])
        ax.plot(aside, sizes, "osD^v"[place], color=color, markersize=3.5, label=f"$x_{{{dof}}}$")
    ax.set_yscale("log")
    ax.set_xticks(result.harmonic)
    ax.set_xlabel(r"multiple of $\Omega$")
    ax.set_ylabel(label("amplitude", result, "harmonics"))
    legend(ax, 5, title=_at(result, index), title_fontsize=7.5)
    return ax


def _telling(result: ResultFile) -> list[int]:
    """Return degrees of freedom for a plot of a few: the limited ones first."""
    computed = [int(dof) for dof in result.dof]
    limited = [c["dof"] for c in constraints_of(result) if c.get("dof") in computed]
    return list(dict.fromkeys([*limited, *computed]))[: len(SERIES)]


def _at(result: ResultFile, index: int) -> str:
    value, text = frequencies(result, result.Omega[index : index + 1])
    unit = text.partition("(")[2].rstrip(")")
    symbol = r"$\Omega$" if "Omega" in text else "$f$"
    name = "impact mode" if getattr(result, "exists", {index: True})[index] else "phantom"
    return f"{name} at {symbol} = {value[0]:.6g} {unit}".rstrip()


def _broken(p: Array) -> Array:
    """Return the curve with gaps at its poles, where it jumps between plus and minus infinity."""
    curve = np.array(p, dtype=np.float64)
    jump = (curve[1:] > 0) != (curve[:-1] > 0)
    # At a zero the curve is small on both sides, at a pole it is large.
    large = np.minimum(np.abs(curve[1:]), np.abs(curve[:-1])) > np.median(np.abs(curve))
    curve[1:][jump & large] = np.nan
    return curve
