"""A large finite-element model, from its files to a reduced one: time and memory."""

from __future__ import annotations

import io
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final

import scipy.io
import scipy.sparse as sparse

import vibroimpact as vi
from benchmarks.memory import status
from benchmarks.solids import solid
from benchmarks.tables import Goal, Table

_COUNTS: Final = 52, 30, 20
"""Nodes of the block in x, y and z; without those that are held, 91,800 degrees of freedom."""
_MODES: Final = 20
_GIBI: Final = 1024.0  # mebibytes


def large_models() -> Table:
    """Read a steel block, held at one end, from its files and reduce it to stops and modes.

    Expected: read within 15 s, reduced within 120 s, in 3 GB at most.
    """
    if not Path("/proc/self/status").exists():
        raise RuntimeError("the system does not tell the memory of a process")
    # A process of its own each: the memory of the one that writes the files is no part of it.
    alone = ProcessPoolExecutor(1, get_context("spawn"), max_tasks_per_child=1)
    with tempfile.TemporaryDirectory() as folder, alone as pool:
        n, size = pool.submit(_write, folder).result()
        rows = pool.submit(_measured, folder).result()
    measured, goal = "measured", "goal"
    return Table(
        f"A model of {n:,} degrees of freedom",
        ("work", "quantity", measured, goal),
        rows,
        f"Trilinear elements; {size:.0f} MB of files as CalculiX writes them; three degrees of "
        f"freedom are kept, with {_MODES} modes of the rest. The memory is the largest of the "
        "process, with its libraries.",
        Goal(measured, goal),
    )


def _write(folder: str) -> tuple[int, float]:
    """Write the block as CalculiX does; return its degrees of freedom and the files' megabytes."""
    block = solid(*_COUNTS)
    model = block.fixed(range(0, block.n // 3, _COUNTS[0]))
    with _path(folder, "dof").open("w") as file:
        file.writelines(f"{node}.{'xyz'.index(part) + 1}\n" for node, part in model.labels)
    with _path(folder, "inp").open("w") as file:
        file.write("*NODE\n")
        file.writelines(f"{node}, {x}, {y}, {z}\n" for node, (x, y, z) in model.coordinates.items())
    for ending, matrix in (("sti", model.K), ("mas", model.M)):
        with _path(folder, ending).open("wb") as file:
            text = io.BytesIO()
            scipy.io.mmwrite(text, sparse.triu(matrix), symmetry="general", precision=14)
            file.write(text.getvalue().split(b"\n", 3)[3])
    return model.n, sum(path.stat().st_size for path in Path(folder).iterdir()) / 1e6


def _path(folder: str, ending: str) -> Path:
    return Path(folder) / f"block.{ending}"


def _measured(folder: str) -> list[tuple[Any, ...]]:
    """Return what reading and reducing take, and the largest memory of this process."""
    rows: list[tuple[Any, ...]] = []

    def timed(what: str, goal: float, work: Callable[[], Any]) -> Any:
        clock, used = time.perf_counter(), time.process_time()
        result = work()
        rows.append((what, "clock [s]", time.perf_counter() - clock, None))
        rows.append((what, "processor, all cores [s]", time.process_time() - used, goal))
        return result

    files = [_path(folder, ending) for ending in ("sti", "mas")]
    deck = _path(folder, "inp")
    model = timed("vi.read_model", 15.0, lambda: vi.read_model(*files, nodes=deck))
    last = model.labels[-1][0]
    keep = [(last, "z"), (last, "y"), (last // 2, "z")]
    small = timed("vi.reduce", 120.0, lambda: vi.reduce(model, keep, _MODES))
    if small.model.n != len(keep) + _MODES:
        raise RuntimeError("the reduced model has other modes")
    rows.append(("both", "memory [GB]", status("VmHWM") / _GIBI, 3.0))
    return rows
