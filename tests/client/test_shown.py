"""What is printed: structures, plans, results and jobs say in a few lines what they are."""

from __future__ import annotations

import json
import pickle
from typing import Any

import httpx2
import numpy as np
import pytest

import vibroimpact as vi
from tests.client.test_results import content
from vibroimpact.jobs import Job, Jobs
from vibroimpact.plans import Plan
from vibroimpact.transport import Transport

STOP = vi.constraint(2, 0.1)


@pytest.mark.parametrize(
    ("structure", "said"),
    [
        (
            vi.chain(3, [STOP]),
            "<Structure chain: n 3, mass 1, stiffness 1; stop at coordinate 2, gap ±0.1>",
        ),
        (vi.bouncing_ball([]), "<Structure bouncing_ball: g 9.81; no stop>"),
        (
            vi.system(np.eye(2), np.ones(2), STOP, force=[0.0, 1.0], damping=0.02),
            "<Structure M 2 × 2, K 2 × 2, diagonal; with damping, force; "
            "stop at coordinate 2, gap ±0.1>",
        ),
        (
            vi.oscillator([vi.constraint(0, {"lower": None, "upper": 0.5}, restitution=0.7)]),
            "<Structure oscillator: Omega0 1, zeta 0; "
            "stop at coordinate 0, from -inf to 0.5, restitution 0.7>",
        ),
        (
            vi.oscillator([vi.constraint(0, {"lower": 0.0, "upper": 0.5}, stiffness=3.0)]),
            "<Structure oscillator: Omega0 1, zeta 0; stop at coordinate 0, from 0 to 0.5, linear>",
        ),
        (
            vi.absorber([vi.constraint(gap=0.5, direction={1: 1.0, 0: -1.0})] * 6),
            "<Structure absorber: Omega0 1, ratio 0.05, tuning 1; 6 stops "
            + ", ".join(["at coordinates 1 and 0, gap ±0.5"] * 4)
            + " and 2 more>",
        ),
    ],
)  # fmt: skip
def test_a_structure_says_what_it_is(structure: Any, said: str) -> None:
    assert repr(structure) == said


@pytest.mark.parametrize(
    ("stop", "said"),
    [
        (vi.constraint(0, {"upper": 0.5}), "stop at coordinate 0, from -inf to 0.5"),
        ({"dof": 0}, "stop {'dof': 0}"),
        ({"gap": "wide", "dof": 0}, "stop {'gap': 'wide', 'dof': 0}"),
        ("none", "stop 'none'"),
    ],
)
def test_what_only_the_service_refuses_has_a_text_too(stop: Any, said: str) -> None:
    assert repr(vi.chain(2, [stop])) == f"<Structure chain: n 2, mass 1, stiffness 1; {said}>"


def test_a_structure_stays_the_document_that_it_is() -> None:
    structure = vi.chain(3, [STOP])
    plain = {
        "preset": "chain", "n": 3, "mass": 1.0, "stiffness": 1.0, "constraints": [STOP],
    }  # fmt: skip
    assert structure == plain
    assert json.loads(json.dumps(structure)) == plain
    assert pickle.loads(pickle.dumps(structure)) == plain


def test_a_plan_is_printed_as_its_steps() -> None:
    step = {"stage": "modes", "method": "dense", "reason": "it is small", "count": 1}
    plan = Plan(steps=[step], skips=[], cached=False, inline=True, seconds=0.25)
    assert repr(plan) == (
        "modes: dense – it is small\nabout 0.25 s of computation, answered directly"
    )


def test_a_result_is_printed_as_the_ranges_of_its_outputs() -> None:
    head, *lines = str(vi.Result(content(5))).splitlines()
    assert head == "time-history, result abababababab"
    assert "  x (5, m): 0 to 4" in lines
    assert "  impacts: 2 rows" in lines


def test_a_large_output_is_not_read_to_be_printed() -> None:
    assert "  x (5000000, m)" in str(vi.Result(content(5_000_000))).splitlines()


def _jobs(count: int) -> Jobs:
    def document(i: int) -> Any:
        return {
            "id": f"job_{i}", "state": "running", "kind": "ensemble",
            "progress": {"done": i, "total": 9}, "created": "2026-11-27T23:32:01.5Z",
        }  # fmt: skip

    transport = Transport(
        "http://service", 5.0, httpx2.MockTransport(lambda _: httpx2.Response(500))
    )
    return Jobs(Job(transport, document(i)) for i in range(count))


def test_jobs_are_a_table_and_can_still_be_gone_through() -> None:
    jobs = _jobs(30)
    assert next(jobs).id == "job_0"
    lines = repr(jobs).splitlines()
    assert lines[0].split() == ["id", "state", "done", "created", "kind", "name"]
    assert lines[1].split() == ["job_1", "running", "1/9", "2026-11-27", "23:32:01", "ensemble"]
    assert len(lines) == 21
    assert "<td" in jobs._repr_html_()
    assert [job.id for job in jobs] == [f"job_{i}" for i in range(1, 30)]
    assert repr(_jobs(0)) == "no jobs"


def test_tables_of_solutions_and_bands_are_summarised() -> None:
    stop = [vi.constraint(0, 1.0)]
    driven = vi.oscillator(stop, 1.0, zeta=0.05)
    motions = vi.Local().periodic_motions(driven, (0.7, 1.6, 30), [vi.drive(0, 1.0)])
    count = int(motions.solution.exists.sum())
    assert f"solution: {motions.solution.exists.size} rows, {count} admissible" in str(motions)
    bands = vi.Local().existence_bands(vi.chain(5, [vi.constraint(2, 0.1)]), 1.0, 2.5)
    widths = bands.bands.stop - bands.bands.start
    said = f"{widths.size} rows, together {widths.sum():.4g} wide, the widest {widths.max():.4g}"
    assert f"bands: {said}" in str(bands)
