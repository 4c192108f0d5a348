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
import scipy.integrate
import scipy.linalg

import vibroimpact as vi
from benchmarks import beams
from benchmarks.harness import measure
from benchmarks.prices import structures as shapes
from benchmarks.solids import solid
from benchmarks.tables import Goal, Table
from vibroimpact_solvers.arrays import Floats

_MILLI: Final = 1e3
_SIZES: Final = (50, 100, 300)
_LARGEST: Final = 50
"""Degrees of freedom up to which kinds that take seconds are asked for."""
_STIFF: Final = 20.0
"""Stiffness of a stop that yields, in that of the beam at its tip."""
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
    shape = np.linalg.solve(K, np.eye(size)[tip])
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
    v = shape / shape[tip]
    history = partial(local.time_history, free, (0.0 * v, v), 20.0 * math.pi / first)
    yield "time history, 10 periods", history, None, None
    if size > _LARGEST:
        return
    stop = vi.constraint(tip, 0.01, stiffness=_STIFF / float(shape[tip]))
    yielding = vi.system(M, K, [stop], damping=rayleigh)
    elastic = partial(local.periodic_motions, yielding, response, load)
    yield "driven response, 50, a stop that yields", elastic, 0.25, None
    bands = partial(local.existence_bands, free, first, 1.3 * first, resolution=1e-3)
    yield "existence bands, resolution 1e-3", bands, 2.0, None
    base = vi.periodic_motions_request(driven, [first], load)
    branch = partial(local.branches, base, "frequency.values.0", 0.7 * first, 1.3 * first)
    yield "branch over the frequency", branch, 3.0, None
    both = vi.system(M, K, [vi.constraint(tip, 0.01, 0.7)], damping=rayleigh)
    states = 0.1 * np.random.default_rng(0).standard_normal((4, size))
    settled = partial(local.attractors, both, 1.1 * first, load, 0.0 * states, states)
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


def finite_elements() -> Table:
    """Ask for modes, responses and histories of a plate, a frame and a reduced solid, three ways.

    The ways are `vi.Local`, `vi.Client` and JSON over HTTP, as by curl.
    """
    rows: list[tuple[Any, ...]] = []
    with vi.Local() as local, vi.Client() as client, httpx2.Client(base_url=client.url) as http:
        for name, M, K, dof in _models():
            for what, one, by_hand in _of_model(M, K, dof):
                ways: dict[str, Work] = {
                    "vi.Local": partial(_call, local.compute, one),
                    "vi.Client": partial(_call, client.compute, one),
                    "HTTP": partial(_call, partial(_json, http), one),
                }
                if by_hand is not None:
                    ways["hand"] = by_hand
                timed = measure(rounds=3, sample=0.0, **ways)
                times = [_MILLI * timed[way].wall if way in timed else None for way in _WAYS]
                rows.append((name, len(M), what, *times))
    return Table(
        "Default requests on finite elements",
        ("structure", "N", "request", *(f"{way} [ms]" for way in _WAYS)),
        rows,
        "On the clock, each time another request, so that no result is stored. A stop at one "
        "degree of freedom; driven motions are damped by 2 % at the first natural frequency. The "
        "solid has 3,465 degrees of freedom and is reduced to its tip and twelve modes. By hand: "
        "for impact modes as above; for histories natural modes by scipy, and solve_ivp with "
        "events and DOP853 at 1e-9 in the ten lowest of them: that is another, coarser model.",
    )


_WAYS: Final = ("vi.Local", "vi.Client", "HTTP", "hand")
_MODES_BY_HAND: Final = 10


def _models() -> Iterator[tuple[str, Floats, Floats, int]]:
    """Yield name, M, K and the degree of freedom with a stop of each structure."""
    yield "plate", *shapes.plate(10), 44
    yield "frame", *shapes.frame(17), 32
    block = solid(21, 11, 5)
    clamped = block.fixed([node for node in range(21 * 11 * 5) if node % 21 == 0])
    small = vi.reduce(clamped, [(21 * 11 * 5 - 1, "z")], modes=12)
    yield "solid, reduced", small.model.M.toarray(), small.model.K.toarray(), 0


def _of_model(
    M: Floats, K: Floats, dof: int
) -> Iterator[tuple[str, Callable[[], Asked], Work | None]]:
    """Yield what is asked for, requests that differ each time, and the same by hand."""
    square, shape = scipy.linalg.eigh(K, M, subset_by_index=[0, 0])
    first, mode = math.sqrt(float(square[0])), shape[:, 0]
    b = 1e-3 / first
    rayleigh: Any = {"rayleigh": [2.0 * first * (0.02 - 0.5 * b * first), b]}
    gap, still = 0.01, np.zeros(len(M))
    # So fast in the first mode that it would swing twice as far as the stop is.
    v = 2.0 * gap * first / mode[dof] * mode
    free = vi.system(M, K, [vi.constraint(dof, gap)])
    driven = vi.system(M, K, [vi.constraint(dof, gap, 0.8)], damping=rayleigh)
    load = [vi.drive(dof, gap * float(square[0] / mode[dof] ** 2))]
    t_end = 20.0 * math.pi / first

    def modes() -> Asked:
        frequencies = np.linspace(1.001 * first * (1.0 + _new()), 1.3 * first, 50)
        return "impact-modes", dict(vi.impact_modes_request(free, frequencies))

    def response() -> Asked:
        frequencies = np.linspace(0.5 * first * (1.0 + _new()), 2.0 * first, 50)
        return "periodic-motions", dict(vi.periodic_motions_request(driven, frequencies, load))

    def history() -> Asked:
        start = still, v * (1.0 + _new())
        return "time-history", dict(vi.time_history_request(free, start, t_end))

    by_hand = np.linspace(1.001 * first, 1.3 * first, 50)
    yield "impact modes, 50", modes, partial(_modes_by_hand, M, K, dof, by_hand)
    yield "driven response, 50", response, None
    yield "time history, 10 periods", history, partial(_history_by_hand, M, K, dof, gap, v, t_end)


def _json(http: httpx2.Client, kind: str, request: dict[str, Any]) -> bytes:
    """Return a result as JSON, as curl would."""
    answer = http.post(f"/v1/compute/{kind}", json=request, timeout=60.0)
    answer.raise_for_status()
    return answer.content


def _history_by_hand(
    M: Floats, K: Floats, dof: int, gap: float, v: Floats, t_end: float
) -> list[float]:
    """Return the times of impacts of the lowest modes, as a user writes it."""
    count = min(_MODES_BY_HAND, len(M))
    squares, modes = scipy.linalg.eigh(K, M, subset_by_index=[0, count - 1])
    row = modes[dof]

    def slope(_: float, z: Floats) -> Floats:
        return np.concatenate([z[count:], -squares * z[:count]])

    def upper(_: float, z: Floats) -> float:
        return float(gap - row @ z[:count])

    def lower(_: float, z: Floats) -> float:
        return float(gap + row @ z[:count])

    events: list[Any] = [upper, lower]
    for event in events:
        event.terminal, event.direction = True, -1.0
    t, z, times = 0.0, np.concatenate([np.zeros(count), modes.T @ (M @ v)]), list[float]()
    while t < t_end:
        piece = scipy.integrate.solve_ivp(
            slope, (t, t_end), z, "DOP853", events=events, rtol=1e-9, atol=1e-12
        )
        t, z = float(piece.t[-1]), piece.y[:, -1].copy()
        if piece.status == 1:
            times.append(t)
            z[count:] -= 2.0 * (row @ z[count:]) / (row @ row) * row
    return times
