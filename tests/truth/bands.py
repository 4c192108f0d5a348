"""Random families, and whether modes exist where their bands say so, and nowhere else."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.reference.balls import UndecidedError
from tests.reference.impact_modes import Family, solved
from tests.truth import impact_modes, structures
from tests.truth.verdicts import Case, Report
from vibroimpact_solvers import existence_bands


def case(rng: np.random.Generator) -> Case:
    """Return a random family with a range of frequencies and places to look at."""
    made = impact_modes.case(rng)
    document = made.document
    Omega = document.pop("Omega")
    width = 10.0 ** rng.uniform(-2, 0.4)
    document.update(start=float(Omega / (1 + width)), stop=float(Omega * (1 + width)))
    document["looks"] = rng.random(16).tolist()
    return Case(made.name, document)


def check(case: Case, report: Report) -> None:
    """Compare the bands of a case with the solutions at frequencies in and beside them."""
    document = case.document
    problem = existence_bands.Problem(
        structures.system(document),
        document["start"],
        document["stop"],
        tuple(document["active"]),
    )
    plan = existence_bands.plan(problem)
    report.work(plan)
    result = existence_bands.solve(problem, plan)
    report.phase("reference")
    assert result.band_start is not None
    assert result.band_stop is not None
    assert result.band_certified is not None
    assert result.band_edge_error is not None
    report.count("bands", len(result.band_start))
    report.count("unresolved ranges", len(result.unresolved_start))
    family = impact_modes.family(document)
    looks = iter(document["looks"])
    bands = list(
        zip(
            result.band_start.tolist(), result.band_stop.tolist(), result.band_edge_error.tolist(),
            result.band_certified.tolist(), strict=True,
        )
    )  # fmt: skip
    unresolved = list(
        zip(result.unresolved_start.tolist(), result.unresolved_stop.tolist(), strict=True)
    )
    chosen = list(range(len(bands)))
    if len(chosen) > 3:
        chosen = sorted({int(next(looks) * len(bands)) for _ in range(3)})
    for k in chosen:
        _band(document, family, bands, k, unresolved, report)
    for look in looks:
        start, stop = document["start"], document["stop"]
        _anywhere(family, float(start + (stop - start) * look), bands, unresolved, report)


def _exists(family: Family, Omega: float, report: Report) -> bool | None:
    report.phase("reference")
    try:
        true = solved(family, Omega).exists()
    except UndecidedError:
        true = None
    report.count("verdicts" if true is not None else "verdicts undecided by the reference")
    return true


def _near(Omega: float, ranges: list[tuple[float, float]], room: float) -> bool:
    return any(start - room <= Omega <= stop + room for start, stop in ranges)


def _band(
    document: structures.Document,
    family: Family,
    bands: list[Any],
    k: int,
    unresolved: list[tuple[float, float]],
    report: Report,
) -> None:
    """Look at the middle of a band, and at both sides of both edges."""
    start, stop, error, certified = bands[k]
    label = "certified" if certified else "not certified"
    room = error + 4.0 * np.spacing(stop)
    if stop - start > 2.0 * room:
        for share in (0.5, 0.03):
            Omega = start + share * (stop - start)
            if _exists(family, Omega, report) is False:
                report.fail(f"band, {label}", f"no mode at {Omega!r} in [{start!r}, {stop!r}]")
                return
    for edge, inward in ((start, 1.0), (stop, -1.0)):
        if edge in (document["start"], document["stop"]):
            continue
        inside, outside = edge + inward * room, edge - inward * room
        if start < inside < stop and _exists(family, inside, report) is False:
            _edge_fails(family, edge, inward * room, report, error, f"edge, {label}", wanted=True)
        others = [(a - e, b + e) for i, (a, b, e, _) in enumerate(bands) if i != k]
        if _near(outside, others, 0.0) or _near(outside, unresolved, room):
            continue
        if document["start"] < outside < document["stop"] and _exists(family, outside, report):
            _edge_fails(family, edge, -inward * room, report, error, f"edge, {label}", wanted=False)


def _edge_fails(
    family: Family,
    edge: float,
    room: float,
    report: Report,
    error: float,
    kind: str,
    *,
    wanted: bool,
) -> None:
    """Note how far the true edge is from the stated one, within a factor of two."""
    side = "inside" if wanted else "outside"
    for _ in range(30):
        if abs(room) > 1e-3 * edge or _exists(family, edge + room, report) is wanted:
            break
        room *= 2.0
    message = f"{edge!r} is off by {0.5 * abs(room):.2g} to {abs(room):.2g} ({side})"
    report.fail(kind, f"{message}, stated {error:.3g}: {abs(room) / error:.2g} times")


def _anywhere(
    family: Family,
    Omega: float,
    bands: list[Any],
    unresolved: list[tuple[float, float]],
    report: Report,
) -> None:
    """Look at a frequency, whether it is in a band or not."""
    if _near(Omega, unresolved, 0.0):
        return
    if any(abs(Omega - edge) <= e for a, b, e, _ in bands for edge in (a, b)):
        return
    within = [certified for a, b, _, certified in bands if a < Omega < b]
    true = _exists(family, Omega, report)
    if true is False and within:
        label = "certified" if within[0] else "not certified"
        report.fail(f"band, {label}", f"no mode at {Omega!r}")
    if true and not within:
        report.fail("band missed", f"a mode at {Omega!r} is in no band")
