"""A first example: Fig. 10.13 of the chapter, computed by a service and checked."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from vibroimpact import plots, style
from vibroimpact.client import Client
from vibroimpact.requests import impact_modes_request
from vibroimpact.results import Result
from vibroimpact.systems import chain, constraint

N, DOF, GAP = 13, 5, 0.2
NATURAL = 2.0 * np.sin(np.pi * np.arange(1, N + 1) / (2 * (N + 1)))
OMEGA = 2.0 / math.pi * NATURAL[4] + 0.02

# The chapter's closed forms 10.65 and 10.66 at this omega, evaluated with 60 digits.
P_REFERENCE = 0.2346217395232693
X_REFERENCE = 0.14069688839403216
_AGREEMENT = 1e-12


def run(out: Path) -> bool:
    """Compute, plot and print; return whether the numbers agree with the chapter."""
    console = Console()
    structure = chain(N, [constraint(DOF, GAP)])
    with console.status("starting a service …"):
        client = Client()
    with client:
        console.print(f"service at {client.url}")
        curve = impact_modes_request(
            structure, (0.6, 2.4, 6001), outputs=("impulse", "exists", "reason", "energy")
        )
        job = client.submit("impact-modes", curve)
        modes = job.wait(progress=True).result()
        mode = client.impact_modes(
            structure, [OMEGA], unit="omega", outputs=("impulse", "exists", "shape", "energy")
        )
        out.mkdir(parents=True, exist_ok=True)
        modes.to_hdf5(out / "impact_modes.h5")
        mode.to_hdf5(out / "mode.h5")
        draw_momentum(modes, mode, out / "momentum.png")
        draw_mode(mode, out / "mode.png")
        computed = [
            ("p", float(mode.impulse[0, 0]), P_REFERENCE),
            ("x₁(τ=1)", float(mode.shape[0, 0]), X_REFERENCE),
        ]
        console.print(_table(computed))
        console.print(f"written: {', '.join(str(path) for path in sorted(out.iterdir()))}")
        # The service compiles the kernels of all kinds meanwhile. What it has not finished by now
        # is shared with it, so that nobody's first request waits for a compiler.
        console.print("The other kinds of computation are made ready; Ctrl-C leaves them.")
        subprocess.run([sys.executable, "-m", "vibroimpact_service.cli", "warm"], check=False)
    console.print(
        "next: vibroimpact gallery 10.13 draws a figure of the chapter; vibroimpact serve starts a "
        "service with a page at its address; docs/start.md begins with a structure of your own",
        soft_wrap=True,
    )
    return all(abs(value / reference - 1.0) < _AGREEMENT for _, value, reference in computed)


def _table(computed: list[tuple[str, float, float]]) -> Table:
    table = Table(title="impact mode of the chain N = 13 at ω = (2/π)Ω₅ + 0.02")
    for column in ("", "computed", "chapter 10", "difference"):
        table.add_column(column, justify="right", no_wrap=True)
    for name, value, reference in computed:
        difference = f"{abs(value / reference - 1.0):.1e}"
        table.add_row(name, f"{value:.17g}", f"{reference:.17g}", difference)
    return table


def draw_momentum(modes: Result, mode: Result, path: Path) -> None:
    """Plot the momentum per impact over Omega, as Fig. 10.13a does with p."""
    ax = plots.momentum(modes, style.new_axes(style.PAGE))
    shown = NATURAL[(modes.Omega[0] <= NATURAL) & (modes.Omega[-1] >= NATURAL)]
    ax.plot(
        shown, np.zeros_like(shown), "o", color=style.WALL, markersize=3,
        label="natural frequencies",
    )  # fmt: skip
    ax.plot(
        mode.Omega, mode.momentum[:, 0], "D", color=style.OTHER, markersize=5,
        label=r"$\omega=(2/\pi)\Omega_5+0.02$",
    )  # fmt: skip
    ax.set_ylim(-0.4, 1.4)
    ax.set_xlim(float(modes.Omega[0]), float(modes.Omega[-1]))
    style.legend(ax)
    style.save(ax, path)


def draw_mode(mode: Result, path: Path) -> None:
    """Plot the mode shape as in Fig. 10.13b."""
    style.save(plots.shape(mode, 0, style.new_axes(style.PAGE)), path)
