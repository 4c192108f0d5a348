"""Shared code of the gallery scripts: colours, plots, and impact modes with soft limiters."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import vibroimpact as vi

BLUE, SOFT, PHANTOM, WALL, OTHER = "#0b5394", "#cc4125", "#b7b7b7", "#c0392b", "#38761d"


def panels(rows: int = 1, columns: int = 1, size: tuple[float, float] = (8.0, 4.0)):
    """Return a figure and its axes."""
    figure = Figure(figsize=size, layout="constrained")
    return figure, figure.subplots(rows, columns)


def profile(ax, x, walls=None, label="", color=BLUE, marker="o"):
    """Plot the displacements of the masses of a chain, counted from 1."""
    masses = np.arange(1, len(x) + 1)
    ax.axhline(0.0, color="black", linewidth=0.5)
    ax.plot(masses, x, "-" + marker, color=color, linewidth=1.2, markersize=5, label=label)
    for mass, wall in (walls or {}).items():
        ax.hlines([-wall, wall], mass - 0.35, mass + 0.35, color=WALL, linewidth=3.0)
    ax.set_xticks(masses)
    ax.set_xlabel("mass")


def impulses(ax, modes, natural, top, index=0, color=BLUE, label="p"):
    """Plot p over Omega, phantoms in grey, natural frequencies as dots."""
    p = modes.impulse[:, index].copy()
    p[np.abs(p) > 20 * top] = np.nan
    ax.plot(modes.Omega, p, color=PHANTOM, linewidth=1.2)
    ax.plot(modes.Omega, np.where(modes.exists, p, np.nan), color=color, linewidth=2, label=label)
    ax.plot(natural, np.zeros(len(natural)), "o", color=WALL, markersize=5)
    ax.axhline(0.0, color="black", linewidth=0.5)
    ax.set_ylim(-0.35 * top, top)
    ax.set_xlim(modes.Omega[0], modes.Omega[-1])
    ax.set_xlabel(r"fundamental frequency $\Omega$")


def mode(client, system, omega, p, dof, t_end, around, **law):
    """Return an impact mode, after checks, and the motion between soft limiters from its start.

    `p` are the expected impulses; the force law is that of `vibroimpact.soft`. The third value is
    the index of the turning point of that motion: the row with the largest displacement of `dof`
    at times within 30 % of `around`.
    """
    result = client.impact_modes(
        system, [omega], unit="omega", outputs=("impulse", "exists", "shape")
    )
    close(result.impulse[0], p)
    assert result.exists[0]
    # The exact free motion over the first quarter, too short for errors to grow.
    quarter = 1 / omega
    exact = client.time_history(
        system, float(result.Omega[0]), quarter, t=[0.0, quarter * (1 - 1e-12)], outputs=("x", "v")
    )
    assert np.abs(exact.x[1] - result.shape[0]).max() < 1e-9 * np.abs(result.shape).max()
    motion = client.time_history(
        system, (exact.x[0], exact.v[0]), t_end, t=6_001, outputs=("x", "energy"),
        limiter=vi.soft(**law),
    )  # fmt: skip
    assert np.abs(motion.energy / motion.energy[0] - 1).max() < 1e-6
    near = np.abs(motion.t / around - 1.0) < 0.3
    return result, motion, int(np.flatnonzero(near)[np.argmax(motion.x[near, dof])])


def close(computed, expected, relative=1e-12) -> None:
    """Assert that numbers agree."""
    np.testing.assert_allclose(computed, expected, rtol=relative, atol=0)
