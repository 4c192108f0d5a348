"""Natural frequencies as users ask for them, read them and look at them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse
from typer.testing import CliRunner

import vibroimpact as vi
from vibroimpact.cli.app import app

pytestmark = pytest.mark.needs("compiled kernels")

SI = {"length": "m", "mass": "kg", "time": "s"}
M, K = np.array([2.0, 2.0, 1.0]), 1e6 * np.array([[4.0, -2, 0], [-2, 4, -2], [0, -2, 2]])
STOPS = [vi.constraint(2, 1e-3), vi.constraint(0, 1e-3)]
BEAM = vi.system(M, K, STOPS, units=SI)
EXACT = np.sqrt(scipy.linalg.eigh(K, np.diag(M), eigvals_only=True))


def test_frequencies_are_there_in_hertz() -> None:
    result = vi.Local().natural_frequencies(BEAM)
    assert isinstance(result, vi.NaturalFrequencies)
    np.testing.assert_allclose(result.Omega, EXACT, rtol=1e-12)
    hertz = result.in_unit(result.Omega, "Hz")
    np.testing.assert_allclose(hertz, EXACT / (2 * np.pi), rtol=1e-12)
    some = vi.Local().natural_frequencies(BEAM, stop=1.001 * hertz[1], unit="Hz")
    assert some.Omega.size == 2
    assert result.shape.shape == (3, 3)
    np.testing.assert_allclose(result.participation, result.shape[:, [2, 0]], rtol=1e-14)
    assert result.unit("shape") == "1/kg^0.5"
    assert result.unit("Omega") == "rad/s"


def test_printed_they_are_a_table() -> None:
    result = vi.Local().natural_frequencies(BEAM, 2, directions=np.ones(3))
    head, columns, *rows = repr(result).splitlines()
    assert head.startswith("<Result natural-frequencies")
    assert columns.split() == [
        "mode", "Omega", "(rad/s)", "frequency", "(Hz)", "error", "effective", "mass", "0", "(kg)",
    ]  # fmt: skip
    assert [row.split()[0] for row in rows] == ["0", "1"]
    assert float(rows[0].split()[2]) == pytest.approx(EXACT[0] / (2 * np.pi), rel=1e-6)
    assert result._repr_html_().count("<tr>") > 6
    many = vi.Local().natural_frequencies(vi.chain(50, []), 40, outputs=["Omega"])
    assert repr(many).splitlines()[-1] == "and 10 more"
    assert repr(many).splitlines()[1].split() == ["mode", "Omega", "error"]


def test_effective_masses_and_residual_flexibilities() -> None:
    result = vi.Local().natural_frequencies(
        BEAM, 1, directions=np.ones(3), outputs=["effective_mass", "residual_flexibility"]
    )
    values, modes = scipy.linalg.eigh(K, np.diag(M))
    np.testing.assert_allclose(result.effective_mass[0], (modes[:, 0] @ M) ** 2, rtol=1e-12)
    rest = modes[[2, 0], 1:]
    expected = (rest / values[1:]) @ rest.T
    np.testing.assert_allclose(result.residual_flexibility, expected, rtol=1e-12, atol=1e-22)
    assert "shape" not in result


def test_they_are_drawn() -> None:
    result = vi.Local().natural_frequencies(BEAM)
    shapes = result.plot()
    assert shapes.get_ylabel() == "mode shape"
    assert len(shapes.get_legend().get_texts()) == 3
    assert "Hz" in shapes.get_legend().get_texts()[0].get_text()
    dots = result.plot(output="Omega")
    assert dots.get_ylabel() == "natural frequency (Hz)"
    np.testing.assert_allclose(dots.lines[0].get_ydata(), EXACT / (2 * np.pi))
    plain = vi.Local().natural_frequencies(vi.chain(5, []), outputs=["Omega"])
    assert plain.plot().get_ylabel() == r"natural frequency $\Omega$"
    with pytest.raises(ValueError, match="can be drawn"):
        result.plot(output="participation")


def test_a_sweep_over_a_stiffness_is_a_table_of_frequencies() -> None:
    base = vi.natural_frequencies_request(vi.chain(9, [vi.constraint(4, 0.2)]), 3, fixed=[0])
    swept = vi.Local().sweep("natural-frequencies", base, {"system.stiffness": [1.0, 4.0]})
    assert swept.Omega.shape == (2, 3)
    np.testing.assert_allclose(swept.Omega[1], 2.0 * swept.Omega[0], rtol=1e-14)
    for path, values in (("count", [2, 3]), ("stop", [1.0])):
        with pytest.raises(vi.InvalidRequest):
            vi.Local().sweep("natural-frequencies", base, {path: values})
    upto = vi.natural_frequencies_request(vi.chain(9, []), stop=1.0)
    with pytest.raises(vi.InvalidRequest, match="count instead of stop"):
        vi.Local().sweep("natural-frequencies", upto, {"system.stiffness": [1.0, 4.0]})


def test_a_model_has_natural_frequencies() -> None:
    model = vi.Model(np.diag(M), K, units=SI)
    np.testing.assert_allclose(model.natural(2), EXACT[:2], rtol=1e-12)
    np.testing.assert_allclose(model.natural(10, unit="Hz"), EXACT / (2 * np.pi), rtol=1e-12)
    assert model.natural(stop=100.0, unit="Hz").size == 1
    held = model.fixed([0]).natural()
    np.testing.assert_allclose(
        held, np.sqrt(scipy.linalg.eigh(K[1:, 1:], np.diag(M[1:]), eigvals_only=True)), rtol=1e-12
    )


def test_a_large_model_has_its_lowest_ones() -> None:
    n = 3000
    line = scipy.sparse.diags_array(
        [np.full(n, 2.0), -np.ones(n - 1), -np.ones(n - 1)], offsets=[0, 1, -1]
    )
    mass = scipy.sparse.diags_array(
        [np.full(n, 4.0 / 6), np.full(n - 1, 1.0 / 6), np.full(n - 1, 1.0 / 6)], offsets=[0, 1, -1]
    )
    # A rod of linear elements: K and M have the same modes, sines.
    angle = np.pi * np.arange(1, 11) / (n + 1)
    exact = np.sqrt((2.0 - 2.0 * np.cos(angle)) / ((2.0 + np.cos(angle)) / 3.0))
    system = vi.system(mass, line, [vi.constraint(7, 0.1)])
    local = vi.Local()
    plan = local.plan("natural-frequencies", vi.natural_frequencies_request(system))
    assert plan["steps"][0]["method"] == "lowest modes"
    result = local.natural_frequencies(system)
    np.testing.assert_allclose(result.Omega, exact, rtol=1e-9)
    assert "certified" in result.error.statement
    assert (result.error.Omega < 1e-12 * result.Omega).all()


def test_what_is_seldom_meant_of_a_structure_is_told_everywhere(
    tmp_path: Path,
) -> None:
    K = np.diag([2.0] * 4) - np.diag([1.0] * 3, 1) - np.diag([1.0] * 3, -1)
    interchanged = vi.system(K, np.eye(4))
    said = "M has the form of a stiffness matrix"
    with pytest.warns(vi.StructureWarning, match=f"natural-frequencies: {said}") as caught:
        result = vi.Local().natural_frequencies(interchanged)
    assert [each.filename for each in caught] == [__file__]
    for text in (str(result), repr(result), result._repr_html_(), *result.cautions):
        assert said in text
    assert result.to_dict()["cautions"] == list(result.cautions)
    # Not by a warning of Python where it is printed anyway.
    request = tmp_path / "request.json"
    request.write_text(json.dumps(vi.natural_frequencies_request(interchanged)))
    done = CliRunner().invoke(app, ["compute", "natural-frequencies", str(request)])
    assert done.exit_code == 0
    assert done.stderr.count(said) == 1
    plain = vi.Local().natural_frequencies(vi.system(np.eye(4), K))
    assert plain.cautions == ()
    assert "cautions" not in plain.to_dict()
