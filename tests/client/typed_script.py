"""A user's script, which strict type checkers read: ``nox -s types``. The tests also run it.

The comments that silence an error show what is refused; where it is not, checkers complain of the
comment.
"""

from __future__ import annotations

from collections.abc import Coroutine
from typing import Any, assert_type

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

import vibroimpact as vi
from vibroimpact import documents

Floats = NDArray[np.float64]


def structure() -> documents.MatrixSystem:
    """Return three masses, the first between stops."""
    M = scipy.sparse.diags_array([1.0, 1.0, 2.0])
    K = np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    return vi.system(
        M, K, [vi.constraint(dof=0, gap=0.1)], units={"length": "m", "mass": "kg", "time": "s"}
    )


def by_kind(client: vi.Client | vi.Local) -> list[vi.Result]:
    """Return results, each of its own type."""
    request = vi.impact_modes_request(
        structure(), (0.7, 3.0, 20), outputs=["impulse", "exists", "shape"]
    )
    assert_type(request, documents.ImpactModesRequest)
    modes = client.compute("impact-modes", request)
    assert_type(modes, vi.ImpactModes)
    assert_type(modes.impulse, Floats)
    assert_type(modes.exists, NDArray[np.bool_])
    assert_type(modes.error.statement, str)
    highest = float(modes.impulse[modes.exists].max())
    bands = client.existence_bands(structure(), 0.1, 0.2, unit="Hz")
    assert_type(bands, vi.ExistenceBands)
    widths = bands.bands.stop - bands.bands.start
    assert widths.size == len(bands.bands.certified)
    assert highest > 0.0
    chain = vi.chain(3, [vi.constraint(0, {"lower": None, "upper": 0.1})])
    motion = client.time_history(
        chain, (np.zeros(3), [1.0, 0.0, 0.0]), 10.0, t=50, load=[vi.harmonic(0, 0.1, 2.0)]
    )
    assert_type(motion, vi.TimeHistory)
    assert_type(motion.impacts.time, Floats)
    assert_type(motion.count.impacts, int)
    grid = client.sweep("impact-modes", request, {"system.constraints.0.gap": [0.1, 0.2]})
    assert_type(grid, vi.Sweep)
    literal: documents.ResonancesRequest = {
        "system": {"preset": "chain", "n": 4, "constraints": [{"dof": 0, "gap": 0.1}]},
        "odd_max": 5,
    }
    internal = client.compute("resonances", literal)
    assert_type(internal.Omega, Floats)
    plan = client.plan("impact-modes", request)
    assert_type(plan.steps[0]["reason"], str)
    return [modes, bands, motion, grid, internal]


def jobs(client: vi.Client) -> documents.Progress:
    """Return the progress of a job."""
    stored = client.store(structure())
    request = vi.impact_modes_request(stored, [1.5], unit="Hz")
    job = client.submit("impact-modes", request, deadline=60.0)
    result = job.wait(timeout=60.0).result()
    assert isinstance(result, vi.ImpactModes)
    assert_type(result.Omega, Floats)
    many = client.submit_many("impact-modes", [request])
    assert_type(many.jobs, list[vi.Job])
    return job.document["progress"]


async def awaited(client: vi.AsyncClient) -> Floats:
    """Return the frequencies of an awaited result."""
    waiting: Coroutine[Any, Any, vi.ImpactModes]
    waiting = client.impact_modes(structure(), np.linspace(1.0, 2.0, 5))
    modes = await waiting
    assert_type(modes, vi.ImpactModes)
    return modes.Omega


def refused(client: vi.Local) -> None:
    """Show what checkers refuse."""
    client.compute("impact-mode", {})  # type: ignore[call-overload]  # pyright: ignore
    wrong: documents.ResonancesRequest = {
        "system": {"preset": "chain", "n": 4, "constraints": []},
        "odd": 5,  # type: ignore[typeddict-unknown-key]  # pyright: ignore
    }
    client.compute("impact-modes", wrong)  # type: ignore[call-overload]  # pyright: ignore
    vi.chain("13", [])  # type: ignore[arg-type]  # pyright: ignore
    vi.constraint(0, gap="wide")  # type: ignore[arg-type]  # pyright: ignore
