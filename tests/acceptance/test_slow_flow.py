"""Slow flows through the client, against a real service."""

from __future__ import annotations

from collections.abc import Iterator

import matplotlib as mpl
import numpy as np
import pytest

import vibroimpact as vi

mpl.use("Agg")


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[vi.Client]:
    with vi.Client(data=tmp_path_factory.mktemp("data")) as opened:
        yield opened


def test_figure_10_19(client: vi.Client) -> None:
    system = vi.oscillator([vi.constraint(0, 1.0, 0.95)])
    errors = {}
    for variant in ("corrected", "printed"):
        result = client.slow_flow(system, "restitution", variant, {"omega": 5}, (0, 100, 2001))
        assert result.x.shape == (2001, 1)
        assert result.stage[0] == "impacts"
        errors[variant] = np.abs(result.error.gamma).max(), np.abs(result.error.phi).max()
    assert errors["corrected"][0] <= 1e-4
    assert errors["corrected"][1] <= 0.02
    assert errors["printed"][0] == pytest.approx(7.5e-2, rel=0.01)
    assert errors["printed"][1] == pytest.approx(3.2, rel=0.01)
    assert "measured" in result.error.statement
    assert "error" in dir(result)
    ax = result.plot()
    assert ax.get_xlabel() == "time"


def test_a_ball_comes_to_rest(client: vi.Client) -> None:
    floor = vi.constraint(0, {"lower": 0.0, "upper": None}, 0.9)
    result = client.slow_flow(
        vi.bouncing_ball([floor]), "bouncing_ball", "exact", {"x": 1.0}, np.linspace(0, 9, 91)
    )
    assert float(result.t_max) == pytest.approx(19 * np.sqrt(2 / 9.81), rel=1e-12)
    assert result.stage[-1] == "rest"
