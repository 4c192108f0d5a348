"""What plausible mistakes are told, and what is shown without being asked for."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import vibroimpact as vi
from vibroimpact.cli.app import app
from vibroimpact_service.local import RefusedError, plan

M = np.eye(2)
K = np.array([[2.0, -1.0], [-1.0, 2.0]])


def test_the_package_offers_what_it_documents_and_nothing_else() -> None:
    assert {"read_model", "reduce", "Model"} <= set(dir(vi))
    assert not {"Any", "TYPE_CHECKING", "arguments"} & set(dir(vi))


@pytest.mark.parametrize(
    ("mistake", "told"),
    [
        (lambda: vi.constraint(0, gap=(0.1, 0.2)), r'\{"lower": 0.1, "upper": 0.2\}'),
        (lambda: vi.system("M.mtx", K), "M must be numbers, not 'M.mtx'; read_model reads files"),
        (lambda: vi.system(Path("M.mtx"), K), "read_model reads files"),
        (lambda: vi.system(M, K, units="SI"), 'such as {"length": "m"'),  # type: ignore[arg-type]
        (lambda: vi.Model(M, K, units="SI"), 'such as {"length": "m"'),  # type: ignore[arg-type]
        (lambda: vi.Model(M, K, units={"length": "m", "mass": "kg"}), '"time": "s"'),
        (
            lambda: vi.periodic_motions_request(
                vi.system(M, K),
                [1.0],
                [vi.harmonic(0, 1.0, frequency=1.0)],  # type: ignore[list-item]
            ),
            "come from `drive`",
        ),
        (
            lambda: vi.time_history_request(vi.system(M, K), np.zeros(9), 1.0),
            "displacements and velocities, .* not 9 numbers",
        ),
    ],
)
def test_a_mistake_is_told_with_what_is_meant(mistake: Any, told: str) -> None:
    with pytest.raises(TypeError, match=told):
        mistake()


def test_a_reduction_is_told_nodes_with_directions() -> None:
    labels = [(17, "z"), (18, "z")]
    for keep in ([17], ["17z"], [(17, "z", 1.0)]):
        with pytest.raises(TypeError, match=r'pairs such as \(17, "z"\)'):
            vi.reduce(vi.Model(M, K, labels=labels), keep, modes=1)  # type: ignore[arg-type]


def test_one_mass_may_be_given_as_numbers() -> None:
    structure = vi.system(2.0, 8.0)
    assert (structure["M"], structure["K"], structure["constraints"]) == ([[2.0]], [[8.0]], [])


def test_presets_without_stops_are_structures_too() -> None:
    assert vi.chain(3)["constraints"] == vi.beam(2)["constraints"] == []


def test_a_path_that_is_not_there_names_those_that_end_alike() -> None:
    base = vi.impact_modes_request(vi.chain(3, [vi.constraint(0, 0.1)]), [1.0])
    request = vi.sweep_request("impact-modes", base, {"gap": [0.1, 0.2]})
    with pytest.raises(RefusedError) as refused:
        plan("sweep", request)
    (fault,) = refused.value.document["errors"]
    assert fault["message"] == "there is no 'gap' in the base; there is system.constraints.0.gap"


def test_models_and_reductions_are_shown_in_a_line() -> None:
    model = vi.Model(M, K, units={"length": "m", "mass": "kg", "time": "s"})
    said = "counted from 0, without nodes and directions; no coordinates; m kg s"
    assert repr(model) == f"<Model: 2 degrees of freedom; {said}>"
    assert repr(vi.reduce(model, [(0, "x")], modes=1)).startswith(
        "<Reduction: 2 degrees of freedom to 2: 1 kept, 0 rigid and 1 elastic modes"
    )
    assert repr(vi.Local()) == "<Local: computes in a process beside the program>"


def test_the_command_line_takes_files_with_matrices(tmp_path: Path) -> None:
    np.savetxt(tmp_path / "M.csv", M, delimiter=",")
    np.savetxt(tmp_path / "K.csv", K, delimiter=",")
    files = ["--model", str(tmp_path / "M.csv"), "--model", str(tmp_path / "K.csv")]
    done = CliRunner().invoke(app, ["compute", "natural-frequencies", *files, "--json"])
    assert done.exit_code == 0, done.stderr
    np.testing.assert_allclose(json.loads(done.stdout)["Omega"], [1.0, 3.0**0.5], rtol=1e-14)
    # Stops are those of the request, in its system.
    request = {"system": {"constraints": [{"dof": 1, "gap": 0.1}]}, "frequency": {"values": [2.0]}}
    text = json.dumps(request)
    done = CliRunner().invoke(app, ["compute", "impact-modes", *files, "--json"], input=text)
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["exists"] == [True]
    wrong = CliRunner().invoke(app, ["compute", "impact-modes", str(tmp_path / "K.csv")])
    assert isinstance(wrong.exception, ValueError)
    assert "K.csv is no request in JSON" in str(wrong.exception)
    assert "files with matrices are given by --model" in str(wrong.exception)


def test_a_result_says_how_it_is_saved_and_why_motions_are_phantoms() -> None:
    # One contact at the upper wall of a coordinate that a large force carries to both.
    stop = vi.constraint(0, gap=0.1, stiffness=50.0)
    structure = vi.system(M, K, [stop], damping=0.05)
    motions = vi.Local().periodic_motions(structure, [0.9, 1.1], [vi.drive(0, 1.0)])
    words, counts = np.unique(motions.solution.reason, return_counts=True)
    assert len(words) > 0
    assert "ok" not in words
    told = ", ".join(
        f"{count} {word}" for count, word in sorted(zip(counts, words, strict=True))[::-1]
    )
    assert f"solution: {counts.sum()} rows, 0 admissible; {told}\n" in str(motions)
    with pytest.raises(AttributeError, match=r"to_pandas\(\), whose tables have to_csv"):
        motions.to_csv("motions.csv")


def test_a_degree_of_freedom_that_is_not_there_is_told_how_they_count() -> None:
    with pytest.raises(vi.errors.InvalidRequest, match=r"dof 2 is none of 0 to 1: they count from"):
        vi.Local().natural_frequencies(vi.system(M, K, [vi.constraint(2, 0.1)]))


@pytest.mark.parametrize("kind", ["impact_modes", "impact-modes"])
def test_kinds_may_be_spelt_as_methods_are(kind: Any) -> None:
    structure = vi.chain(3, [vi.constraint(dof=1, gap=0.2)])
    request = vi.impact_modes_request(structure, [2.1])
    with vi.Client() as client:
        assert client.plan(kind, request).steps
        assert client.submit(kind, request).wait().result().kind == "impact-modes"
        swept = client.sweep(kind, request, {"system.constraints.0.gap": [0.1, 0.2]})
    assert swept.impulse.shape == (2, 1, 1)
    assert vi.Local().plan(kind, request).steps
