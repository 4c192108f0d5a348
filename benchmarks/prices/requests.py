"""Honest requests of every kind, drawn by seed: what users of such structures ask for."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

import numpy as np

from benchmarks.prices.structures import Structure, draw

Document = dict[str, Any]
Random = np.random.Generator


class Case(NamedTuple):
    """A request, the kind it is of, and what it is about."""

    kind: str
    about: str
    document: Document


def case(name: str, seed: int) -> Case:
    """Return the request of a name of `DRAWN` with a seed."""
    kind, make = DRAWN[name]
    random = np.random.default_rng([zlib.crc32(name.encode()), seed])
    about, document = make(random)
    return Case(kind, about, document)


def _count(random: Random, least: float, most: float) -> int:
    """Return a number whose logarithm is uniform."""
    return int(np.exp(random.uniform(np.log(least), np.log(most + 0.99))))


def _band(random: Random, one: Structure, low: float, high: float) -> tuple[float, float]:
    """Return a range of frequencies about the first natural frequency."""
    start = one.first * random.uniform(low, 1.0)
    return float(start), float(start + one.first * random.uniform(0.2, high))


def _some(random: Random, *names: str) -> list[str]:
    return [name for name in names if random.random() < 0.4]


def _modes(random: Random) -> tuple[str, Document]:
    one = draw(random, largest=True)
    start, stop = _band(random, one, 0.5, 3.0)
    num = _count(random, 1, 1000)
    document: Document = {
        "system": one.document,
        "frequency": {"start": start, "stop": stop, "num": num},
    }
    more = _some(random, "shape", "energy", "waveform", "harmonics")
    if more and random.random() < 0.5:
        document["outputs"] = ["impulse", "exists", "reason", *more]
        document["dofs"] = [one.dof]
        if "waveform" in more:
            document["tau"] = np.linspace(-1.0, 1.0, 21).tolist()
    return f"{one.name}, {num} frequencies", document


def _modes_with_stability(random: Random) -> tuple[str, Document]:
    one = draw(random)
    start, stop = _band(random, one, 0.5, 3.0)
    num = _count(random, 1, 100)
    return f"{one.name}, {num} frequencies", {
        "system": one.document,
        "frequency": {"start": start, "stop": stop, "num": num},
        "outputs": ["impulse", "exists", "reason", "stability"],
    }


def _bands(random: Random) -> tuple[str, Document]:
    one = draw(random, small=random.random() < 0.7)
    start, stop = _band(random, one, 0.4, 3.0)
    document: Document = {"system": one.document, "frequency": {"start": start, "stop": stop}}
    if one.n <= 30 and random.random() < 0.4:
        document["outputs"] = ["bands", "rejected", "stability"]
    if random.random() < 0.25:  # unequal gaps: searched for
        limiter = {"dof": one.dof, "gap": {"lower": one.gap, "upper": 1.5 * one.gap}}
        document["system"] = {**one.document, "constraints": [limiter]}
    return f"{one.name}, {stop / start:.2g} times", document


def _natural(random: Random) -> tuple[str, Document]:
    one = draw(random, largest=True)
    count = _count(random, 1, 50)
    outputs = ["Omega", "shape", "participation"]
    if random.random() < 0.5:
        outputs.append("residual_flexibility")
    document = {"system": one.document, "count": count, "outputs": outputs}
    return f"{one.name}, {count} modes", document


def _resonances(random: Random) -> tuple[str, Document]:
    one = draw(random, largest=True)
    odd_max = 2 * _count(random, 1, 50) - 1
    return f"{one.name}, to {odd_max}", {"system": one.document, "odd_max": odd_max}


def _driven(random: Random, one: Structure) -> Document:
    """Return a structure with one stop, or one wall, and a load that drives it there."""
    system = one.damped
    if random.random() < 0.3:
        limiter = {**system["constraints"][0], "gap": {"lower": None, "upper": one.gap}}
        system = {**system, "constraints": [limiter]}
    size = one.force(float(random.uniform(1.5, 8.0)))
    return {"system": system, "load": [{"dof": one.dof, "amplitude": size}]}


def _periodic(random: Random) -> tuple[str, Document]:
    one = draw(random, small=random.random() < 0.8)
    start, stop = _band(random, one, 0.5, 1.5)
    num = _count(random, 1, 50)
    document = {
        **_driven(random, one),
        "frequency": {"start": start, "stop": stop, "num": num},
    }
    both = document["system"]["constraints"][0]["gap"] == one.gap
    if both and random.random() < 0.5:
        document["sequence"] = "symmetric"
    if random.random() < 0.4:
        document["outputs"] = ["exists", *_some(random, "extremes", "energy", "stability")]
    if one.n <= 30 and num <= 5 and random.random() < 0.2:
        document["sequence"] = [{"constraint": 0}, {"constraint": 0}]
    asked = ", ".join(document.get("outputs", ["all"]))
    return f"{one.name}, {num} frequencies, {asked}", document


def _periodic_with_stops(random: Random) -> tuple[str, Document]:
    one = draw(random, small=True)
    start, stop = _band(random, one, 0.5, 1.5)
    num = _count(random, 1, 40)
    document = {**_driven(random, one), "frequency": {"start": start, "stop": stop, "num": num}}
    (limiter,) = document["system"]["constraints"]
    law = {"type": "linear", "stiffness": one.first**2 / one.share * float(random.uniform(3, 300))}
    if random.random() < 0.5:
        law["restitution"] = float(random.uniform(0.5, 0.95))
    kept = {name: value for name, value in limiter.items() if name != "restitution"}
    document["system"] = {**document["system"], "constraints": [{**kept, "law": law}]}
    if limiter["gap"] == one.gap and random.random() < 0.5:
        document["sequence"] = "symmetric"
    if random.random() < 0.4:
        document["outputs"] = ["exists", *_some(random, "extremes", "energy", "stability")]
    asked = ", ".join(document.get("outputs", ["all"]))
    return f"{one.name}, {num} frequencies, {asked}", document


def _branches(random: Random) -> tuple[str, Document]:
    one = draw(random, small=True)
    at = one.first * float(random.uniform(0.9, 1.2))
    base = {**_driven(random, one), "frequency": {"values": [at]}}
    both = base["system"]["constraints"][0]["gap"] == one.gap
    if both and random.random() < 0.5:
        base["sequence"] = "symmetric"
    if random.random() < 0.5:
        base["outputs"] = ["exists", "stability"]
    path, value = [
        ("frequency.values.0", at),
        ("load.0.amplitude", base["load"][0]["amplitude"]),
        ("system.constraints.0.gap", one.gap),
    ][int(random.integers(3 if both else 2))]
    document = {"base": base, "path": path, "start": 0.8 * value, "stop": 1.3 * value}
    if random.random() < 0.4:
        document["step"] = float(random.uniform(0.01, 0.2))
    return f"{one.name} over {path}", document


def _states(random: Random, one: Structure, count: int) -> Document:
    x = np.zeros((count, one.n))
    v = np.zeros((count, one.n))
    x[:, one.dof] = one.gap * random.uniform(-0.9, 0.9, count)
    v[:, one.dof] = one.gap * one.first * random.uniform(-3.0, 3.0, count)
    return {"x": x.tolist(), "v": v.tolist()}


def _attractors(random: Random) -> tuple[str, Document]:
    one = draw(random, small=True)
    count = _count(random, 1, 20)
    document = {
        **_driven(random, one),
        "frequency": {"values": [one.first * float(random.uniform(0.7, 1.6))]},
        "initial": _states(random, one, count),
    }
    if random.random() < 0.6:
        document["settle"], document["observe"] = _count(random, 20, 200), _count(random, 40, 200)
    return f"{one.name}, {count} motions", document


def _motion(random: Random, one: Structure, count: int) -> Document:
    """Return what histories and ensembles share."""
    periods = _count(random, 2, 50)
    t_end = periods * 2.0 * np.pi / one.first
    document: Document = {"system": one.document if random.random() < 0.4 else one.damped}
    document["initial"], document["t_end"] = _states(random, one, count), float(t_end)
    if random.random() < 0.6:
        document["t"], document["outputs"] = (
            {"num": _count(random, 10, 1000)},
            ["x", "v", "impacts", *_some(random, "energy")],
        )
        if random.random() < 0.5:
            document["dofs"] = [one.dof]
    if random.random() < 0.4:
        size, frequency = one.force(float(random.uniform(1.0, 6.0))), one.first * 1.1
        document["load"] = [{"dof": one.dof, "amplitude": size, "frequency": frequency}]
    return document


def _history(random: Random) -> tuple[str, Document]:
    one = draw(random, largest=random.random() < 0.3)
    document = _motion(random, one, 1)
    document["initial"] = {name: rows[0] for name, rows in document["initial"].items()}
    chance = random.random()
    if chance < 0.15 and one.n <= 60:
        document["limiter"] = {"law": "power", "exponent": 17, "stiffness": 1, "scale": one.gap}
        document["system"] = one.document
    elif chance < 0.3 and one.n <= 60 and "load" not in document:
        document["system"] = one.document
        Omega = one.first * float(random.uniform(1.2, 2.0))
        document["initial"] = {"impact_mode": {"Omega": Omega}}
    return f"{one.name}, t_end = {document['t_end']:.3g}", document


def _ensemble(random: Random) -> tuple[str, Document]:
    one, count = draw(random, small=True), _count(random, 2, 200)
    document = _motion(random, one, count)
    return f"{one.name}, {count} motions", document


def _slow(random: Random) -> tuple[str, Document]:
    model = str(random.choice(["damped", "two_oscillator", "restitution", "bouncing_ball"]))
    num, end = _count(random, 10, 3000), float(random.uniform(5.0, 150.0))
    wall: Document = {"dof": 0, "gap": 1.0}
    variants = ["exact", "transformed", "averaged", "truncated"]
    system: Document = {"preset": "oscillator", "Omega0": 1.0}
    initial: Document = {"gamma": float(random.uniform(0.1, 0.5))}
    if model == "damped":
        system["zeta"] = float(random.uniform(0.002, 0.02))
    elif model == "two_oscillator":
        system = {"preset": "two_mass", "Omega0": 1.0, "coupling": 0.05, "zeta": 0.005}
    elif model == "restitution":
        wall["restitution"] = float(random.uniform(0.85, 0.98))
        variants = ["exact", "corrected", "second_order", "high_energy"]
        end = min(end, 20.0)
    else:
        system = {"preset": "bouncing_ball", "g": 9.81}
        wall = {"dof": 0, "gap": {"lower": 0.0, "upper": None}}
        wall["restitution"] = float(random.uniform(0.8, 0.97))
        variants, initial, end = ["exact", "nstt", "nsct"], {"x": 1.0}, min(end, 9.0)
    variant = str(random.choice(variants))
    return f"{model} {variant}, {num} times", {
        "system": {**system, "constraints": [wall]},
        "model": model,
        "variant": variant,
        "initial": initial,
        "t": {"start": 0.0, "stop": end, "num": num},
    }


def _sweep(random: Random) -> tuple[str, Document]:
    one = draw(random, small=True)
    points = _count(random, 2, 40)
    gaps = {
        "path": "system.constraints.0.gap",
        "start": 0.7 * one.gap,
        "stop": 1.5 * one.gap,
        "num": points,
    }
    kind = str(random.choice(["impact-modes", "time-history", "periodic-motions"]))
    base: Document
    if kind == "impact-modes":
        start, stop = _band(random, one, 0.5, 3.0)
        num = _count(random, 1, 100)
        base = {"system": one.document, "frequency": {"start": start, "stop": stop, "num": num}}
        if "preset" in one.document:
            gaps = {"path": "system.stiffness", "start": 0.8, "stop": 1.2, "num": points}
    elif kind == "time-history":
        base = _motion(random, one, 1)
        base["initial"] = {
            name: [0.5 * v for v in rows[0]] for name, rows in base["initial"].items()
        }
    else:
        base = {**_driven(random, one), "frequency": {"values": [one.first * 1.1]}}
        gaps = {
            "path": "load.0.amplitude",
            "start": base["load"][0]["amplitude"],
            "stop": 2.0 * base["load"][0]["amplitude"],
            "num": points,
        }
        base["outputs"] = ["exists", "stability"]
    return f"{one.name}, {points} points of {kind}", {"kind": kind, "base": base, "axes": [gaps]}


DRAWN: Final[Mapping[str, tuple[str, Callable[[Random], tuple[str, Document]]]]] = {
    "impact-modes": ("impact-modes", _modes),
    "impact-modes with stability": ("impact-modes", _modes_with_stability),
    "existence-bands": ("existence-bands", _bands),
    "natural-frequencies": ("natural-frequencies", _natural),
    "resonances": ("resonances", _resonances),
    "periodic-motions": ("periodic-motions", _periodic),
    "periodic-motions with stops": ("periodic-motions", _periodic_with_stops),
    "branches": ("branches", _branches),
    "attractors": ("attractors", _attractors),
    "time-history": ("time-history", _history),
    "ensemble": ("ensemble", _ensemble),
    "slow-flow": ("slow-flow", _slow),
    "sweep": ("sweep", _sweep),
}
"""Name in the table -> kind and the function that draws a request."""
