"""Fits the rates of `vibroimpact_solvers.rates` to measured requests, and writes them."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from pydantic import TypeAdapter
from scipy.optimize import least_squares

from benchmarks.prices.measured import Measured, planned, spectrum_seconds
from benchmarks.prices.requests import DRAWN, case
from benchmarks.prices.structures import structure
from vibroimpact_schema.systems import AnySystem
from vibroimpact_service.documents import decode
from vibroimpact_solvers import plan as pricing
from vibroimpact_solvers import rates, spectrum
from vibroimpact_solvers.arrays import Booleans, Floats
from vibroimpact_solvers.plan import BYTES_PER_SECOND, OVERHEAD_SECONDS, Plan
from vibroimpact_solvers.rates import Rate, Sweep

_START, _EACH = 1e-4, 1e-9  # what is taken where measurements tell nothing
_PULL = 0.1  # towards that, by factors of e
_WIDTH = 0.7  # logarithm of a ratio beyond which a request counts as an exception
_TRIALS = 3
_SPECTRA: Final = {
    "oscillator": (1,), "chain": (2, 10, 50, 200), "uneven": (2, 5, 15, 40, 100, 250, 500),
    "plate": (4, 16, 49, 100, 225, 400), "beam": (3, 8, 16, 25, 50, 150, 300),
    "frame": (8, 16, 48, 96, 200), "dense": (2, 5, 10, 20, 40, 80, 200, 500),
}  # fmt: skip
"""Families and sizes whose natural modes are measured."""


class Samples(NamedTuple):
    """Measured requests of a kind."""

    features: Floats
    """Of each request and constant, (request, constant): the time is their sum."""
    known: Floats
    """What the price has beside them, (request,)."""
    seconds: Floats
    ended: Booleans
    """Requests that took longer than that."""


def fitted(samples: Samples, guess: Floats, pull: Floats | float = _PULL) -> Floats:
    """Return the constants, positive, whose sums are near the times by their ratios.

    Where they tell nothing, constants stay near a guess, to which `pull` draws them. Exceptions
    count little; requests that were ended count where they are estimated below.
    """

    def residuals(logarithms: Floats) -> Floats:
        estimates = samples.features @ np.exp(logarithms) + samples.known
        off = np.log(estimates / samples.seconds)
        off = np.where(samples.ended, np.minimum(off, 0.0), off)
        return np.concatenate([off, pull * (logarithms - first)])

    first, random = np.log(guess), np.random.default_rng(1)
    starts = [first + k * random.standard_normal(guess.size) for k in range(_TRIALS)]
    fits = [least_squares(residuals, s, loss="soft_l1", f_scale=_WIDTH) for s in starts]
    return np.asarray(np.exp(min(fits, key=lambda one: one.cost).x))


def calibrate(rows: Sequence[Measured], longest: float) -> tuple[dict[str, Rate], Sweep]:
    """Return the rates of all methods that the requests use, and those of sweeps."""
    plans = [planned(case(row.name, row.seed)).plan for row in rows]
    table = _of_spectra()
    for kind in dict.fromkeys(kind for kind, _ in DRAWN.values() if kind != "sweep"):
        own = [(row, plan) for row, plan in zip(rows, plans, strict=True) if plan.kind == kind]
        if own:
            table |= _of_kind(kind, own, table, longest)
    swept = [(row, plan) for row, plan in zip(rows, plans, strict=True) if plan.of]
    return table, _of_sweeps(swept, table, longest) if swept else rates.SWEEP


def _of_spectra() -> dict[str, Rate]:
    """Measure natural modes alone: they take the same in all kinds."""
    table: dict[str, Rate] = {}
    taken: dict[str, list[tuple[float, float]]] = {}
    for family, sizes in _SPECTRA.items():
        for size in sizes:
            document = structure(family, size, 0).document
            of = decode.system(TypeAdapter(AnySystem).validate_python(document))
            method = spectrum.choose(of)
            name = spectrum.step(of, method).rate_name("")
            taken.setdefault(name, []).append((spectrum.flops(of, method), spectrum_seconds(of)))
    for name, pairs in taken.items():
        flops, seconds = np.array(pairs).T
        features = np.column_stack([np.ones(flops.size), flops])
        ended = np.zeros(flops.size, dtype=bool)
        samples = Samples(features, np.zeros(flops.size), seconds, ended)
        table[name] = Rate(*fitted(samples, np.array([_START, _EACH])).tolist())
    return table


def _of_kind(
    kind: str, own: list[tuple[Measured, Plan]], spectra: dict[str, Rate], longest: float
) -> dict[str, Rate]:
    each = [step for _, plan in own for step in plan.steps]
    names = sorted({step.rate_name(kind) for step in each} - spectra.keys())
    features = np.zeros((len(own), 2 * len(names) + 1))
    features[:, -1] = 1.0
    known = np.zeros(len(own))
    for row, (_, plan) in enumerate(own):
        for step in plan.steps:
            name = step.rate_name(kind)
            if name in spectra:
                known[row] += spectra[name].start + spectra[name].each * step.flops
            elif step.flops:
                place = 2 * names.index(name)
                features[row, place] += 1.0
                features[row, place + 1] += step.flops
    samples = _samples(features, own, longest)
    samples = samples._replace(known=samples.known + known)
    pull = np.array([*np.tile([_PULL, _PULL], len(names)), 0.3 * _PULL])
    constants = fitted(samples, np.array([*np.tile([_START, _EACH], len(names)), _START]), pull)
    pairs = constants[:-1].reshape(-1, 2).tolist()
    rates_of_methods = {name: Rate(*pair) for name, pair in zip(names, pairs, strict=True)}
    return {kind: Rate(float(constants[-1]), 0.0)} | rates_of_methods


def _of_sweeps(own: list[tuple[Measured, Plan]], table: dict[str, Rate], longest: float) -> Sweep:
    unknown = Rate(0.0, _EACH)
    features = []
    for _, plan in own:
        pairs = [(table.get(step.rate_name(plan.of), unknown), step.flops) for step in plan.steps]
        begun = table[plan.of].start + sum(rate.start for rate, _ in pairs)
        work = sum(rate.each * flops for rate, flops in pairs)
        features.append([1.0, float(plan.points), plan.points * begun, work])
    samples = _samples(np.array(features), own, longest)
    return Sweep(*fitted(samples, np.array([1e-3, 1e-3, 0.5, 0.5])).tolist())


def _samples(features: Floats, own: list[tuple[Measured, Plan]], longest: float) -> Samples:
    seconds = np.array([row.measured for row, _ in own])
    ended = np.isinf(seconds)
    known = [OVERHEAD_SECONDS + plan.bytes / BYTES_PER_SECOND for _, plan in own]
    return Samples(features, np.array(known), np.where(ended, longest, seconds), ended)


def use(table: dict[str, Rate], sweep: Sweep) -> None:
    """Let the estimates of this process use other rates."""
    pricing.RATES, pricing.SWEEP = table, sweep  # type: ignore[attr-defined]


def estimates(rows: Sequence[Measured]) -> list[Measured]:
    """Return the rows with the estimates that their requests have now."""
    return [row._replace(estimate=planned(case(row.name, row.seed)).seconds) for row in rows]


def held_out(rows: Sequence[Measured], longest: float) -> list[Measured]:
    """Return all rows, with estimates by rates that were fitted to the other half of the seeds."""
    all_rows: list[Measured] = []
    for half in range(2):
        use(*calibrate([row for row in rows if row.seed % 2 != half], longest))
        all_rows += estimates([row for row in rows if row.seed % 2 == half])
    return sorted(all_rows, key=lambda row: list(DRAWN).index(row.name))


def with_others(table: dict[str, Rate]) -> dict[str, Rate]:
    """Return rates that were fitted, and those of kinds and spectra that were not measured."""
    known = {
        name: rate for name, rate in rates.RATES.items() if name.partition(":")[0] not in table
    }
    order = list(rates.RATES)
    place = {name: index for index, name in enumerate(order)}
    both = known | table
    return {name: both[name] for name in sorted(both, key=lambda name: place.get(name, len(order)))}


def write(table: dict[str, Rate], sweep: Sweep) -> None:
    """Write the module of rates; kinds that were not measured keep theirs."""
    table = with_others(table)
    module = Path(inspect.getfile(rates))
    text, _, _ = module.read_text().partition("SWEEP: Final")
    lines = [
        f"SWEEP: Final = Sweep({', '.join(f'{value:.2g}' for value in sweep)})",
        "RATES: Final[Mapping[str, Rate]] = {",
        *(f'    "{name}": Rate({start:.2g}, {each:.2g}),' for name, (start, each) in table.items()),
        "}",
    ]
    module.write_text(text + "\n".join(lines) + "\n")
