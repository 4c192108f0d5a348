"""What users get by default: each kind's default request, in process, by the client, over HTTP."""

from __future__ import annotations

import io
import itertools
import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Final

import h5py
import httpx2
import numpy as np
import scipy.linalg

import vibroimpact as vi
from benchmarks import beams
from benchmarks.harness import measure
from benchmarks.tables import Goal, Table
from vibroimpact_solvers.arrays import Floats

_MILLI: Final = 1e3
_SIZES: Final = (50, 100, 300)
_LARGEST: Final = 50
"""Degrees of freedom up to which kinds that take seconds are asked for."""
_number: Final = itertools.count(1)
Work = Callable[[], object]


def _new() -> float:
    """Return a number unlike all before, so that no result is stored yet."""
    return 1e-9 * next(_number)


def calls() -> Table:
    """Ask for one impact mode, a history and a driven response, from Python and as HDF5 files."""
    rows: list[tuple[Any, ...]] = []
    with vi.Local() as local, vi.Client() as client, httpx2.Client(base_url=client.url) as http:
        for name, (one, goals) in _small().items():
            ways: dict[str, Work] = {
                "in process, vi.Local": partial(_call, local.compute, one),
                "vi.Client, new": partial(_call, client.compute, one),
                "vi.Client, stored": partial(client.compute, *one()),
                "HDF5 over HTTP, new": partial(_call, partial(_file, http), one),
            }
            datasets = _datasets(_file(http, *one()))
            timed = measure(rounds=25, sample=0.0, **ways)
            rows += [
                (name, way, datasets, _MILLI * timed[way].wall, goal)
                for way, goal in zip(ways, goals, strict=True)
            ]
    return Table(
        "One call",
        ("request", "way", "datasets", "time [ms]", "goal"),
        rows,
        "Chain of 13 masses with one stop; the driven response is that of one mass at 1,000 "
        "frequencies. On the clock, plan, checks and stated errors included; client, service and "
        "what else the machine does share its cores.",
        Goal("time [ms]", "goal"),
        reasons={"": "on the clock, beside whatever else the machine does"},
    )


Asked = tuple[str, dict[str, Any]]


def _small() -> dict[str, tuple[Callable[[], Asked], tuple[float | None, ...]]]:
    """Return requests, each time another one, and the goals of the ways, ms."""
    chain, x = vi.chain(13, [vi.constraint(5, 0.2)]), [0.0] * 13
    mass = vi.system([[1.0]], [[1.0]], [vi.constraint(0, 0.5, 0.8)], damping={"ratio": 0.01})

    def mode() -> Asked:
        return "impact-modes", dict(vi.impact_modes_request(chain, [0.5 + _new()]))

    def history() -> Asked:
        initial = x, [1.0 + _new(), *x[1:]]
        times = np.linspace(0.0, 62.0, 10)
        return "time-history", dict(vi.time_history_request(chain, initial, 62.0, t=times))

    def response() -> Asked:
        frequency = 0.1 + _new(), 1.9, 1000
        return "periodic-motions", dict(
            vi.periodic_motions_request(mass, frequency, [vi.drive(0, 1.0)])
        )

    return {
        "impact mode": (mode, (0.6, 3.0, 1.2, 5.0)),
        "history, 20 impacts, 10 outputs": (history, (0.6, 3.0, 1.2, 12.0)),
        "driven response": (response, (150.0, None, None, None)),
    }


def _call(ask: Callable[..., object], one: Callable[[], Asked]) -> object:
    """Ask for another request each time."""
    return ask(*one())


def _file(http: httpx2.Client, kind: str, request: dict[str, Any]) -> bytes:
    """Return a result as an HDF5 file, as curl would."""
    headers = {"Accept": "application/x-hdf5"}
    answer = http.post(f"/v1/compute/{kind}", json=request, headers=headers, timeout=60.0)
    answer.raise_for_status()
    return answer.content


def _datasets(content: bytes) -> int:
    names = list[str]()
    with h5py.File(io.BytesIO(content)) as file:
        file.visititems(
            lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None
        )
    return len(names)


def kinds() -> Table:
    """Ask `vi.Local` for each kind's default request on cantilevers of beam elements."""
    rows: list[tuple[Any, ...]] = []
    with vi.Local() as local:
        for size in _SIZES:
            for kind, work, goal, by_hand in _of_beam(local, size):
                took = measure(rounds=1, sample=0.0, work=work)["work"].wall
                other = None
                if by_hand is not None:
                    other = measure(rounds=3, sample=0.0, work=by_hand)["work"].wall
                rows.append((kind, size, took, goal, other))
    return Table(
        "Default requests on beams",
        ("request", "N", "time [s]", "goal", "by hand [s]"),
        rows,
        "On the clock. Cantilevers of Euler-Bernoulli elements with a stop at the tip, damped by "
        "2 % at the first natural frequency where motions are driven. By hand: what a user would "
        "write instead, without errors or proofs: natural modes by scipy, modal sums by numpy, "
        "limits looked at in 1,000 moments, which takes 7 of 50 impact modes that penetrate their "
        "stop (N=50) for existing ones.",
        Goal("time [s]", "goal"),
        reasons={
            "": "beams rest at their stop several times a period, and each motion has integrals "
            "and extremes at thousands of nodes"
        },
    )


def _of_beam(local: vi.Local, size: int) -> Iterator[tuple[str, Work, float | None, Work | None]]:
    """Yield name, call, goal in seconds and what a user would write instead, of each kind."""
    M, K = beams.matrices(size // 2)
    tip, first = size - 2, math.sqrt(float(scipy.linalg.eigh(K, M, eigvals_only=True)[0]))
    free = vi.system(M, K, [vi.constraint(tip, 0.01)])
    stop = vi.constraint(tip, {"lower": 0.01, "upper": 0.01}, 0.8)
    b = 1e-3 / first
    rayleigh: Any = {"rayleigh": [2.0 * first * (0.02 - 0.5 * b * first), b]}
    driven = vi.system(M, K, [stop], damping=rayleigh)
    load = [vi.drive(tip, 3.0)]
    modes, response = (1.001 * first, 1.3 * first, 50), (0.5 * first, 2.0 * first, 50)
    by_hand = partial(_modes_by_hand, M, K, tip, np.linspace(*modes))
    stability = ("impulse", "exists", "reason", "stability")
    yield (
        "natural frequencies",
        partial(local.natural_frequencies, free),
        None,
        partial(scipy.linalg.eigh, K, M),
    )
    yield "impact modes, 50", partial(local.impact_modes, free, modes), None, by_hand
    stable = partial(local.impact_modes, free, modes, outputs=stability)
    yield "with their stability", stable, 3.0 if size == 300 else None, None
    goal = {100: 0.3, 300: 2.0}.get(size)
    yield "driven response, 50", partial(local.periodic_motions, driven, response, load), goal, None
    # In the shape of a static deflection, at the speed 1 of the tip.
    v = np.linalg.solve(K, np.eye(size)[tip])
    v /= v[tip]
    history = partial(local.time_history, free, (0.0 * v, v), 20.0 * math.pi / first)
    yield "time history, 10 periods", history, None, None
    if size > _LARGEST:
        return
    bands = partial(local.existence_bands, free, first, 1.3 * first, resolution=1e-3)
    yield "existence bands, resolution 1e-3", bands, 2.0, None
    base = vi.periodic_motions_request(driven, [first], load)
    branch = partial(local.branches, base, "frequency.values.0", 0.7 * first, 1.3 * first)
    yield "branch over the frequency", branch, 3.0, None
    upper = vi.system(M, K, [vi.constraint(tip, 0.01, 0.7)], damping=rayleigh)
    states = 0.1 * np.random.default_rng(0).standard_normal((4, size))
    settled = partial(local.attractors, upper, 1.1 * first, load, 0.0 * states, states)
    yield "attractors, four states", settled, 3.0, None


def _modes_by_hand(M: Floats, K: Floats, tip: int, Omega: Floats) -> tuple[Floats, list[bool]]:
    """Return impulses of impact modes up to a factor, and which exist, as a user writes it."""
    squares, shapes = scipy.linalg.eigh(K, M)
    roots, row = np.sqrt(squares), shapes[tip]
    impulses, exists = np.empty(Omega.size), list[bool]()
    for i, half in enumerate(np.pi / Omega):
        # Between impacts, t from -half/2 to half/2, a mode moves as a sine about its middle.
        t = half * np.linspace(-0.5, 0.5, 1000)
        x = (row**2 / (2.0 * roots * np.cos(0.5 * roots * half))) @ np.sin(np.outer(roots, t))
        impulses[i] = 0.01 / abs(x[-1])
        # The impulse is positive, so that it begins at the lower stop.
        moves = impulses[i] * np.abs(x) <= 0.01 * (1.0 + 1e-9)
        exists.append(bool(x[-1] > 0.0 and moves.all()))
    return impulses, exists
