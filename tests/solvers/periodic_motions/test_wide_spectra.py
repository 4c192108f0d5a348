"""Beams of elements: most of their modes die long before the next impact."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tests.solvers import beams
from vibroimpact_solvers import periodic_motions as driven
from vibroimpact_solvers.kernels.orbits import Mesh
from vibroimpact_solvers.periodic_motions import along, multipliers

ALL = frozenset({"exists", "extremes", "energy", "multipliers", "waveform"})
pytestmark = pytest.mark.needs("compiled kernels")


def response(*, symmetric: bool = False, elements: int = 12) -> driven.Result:
    """Return the driven response of a cantilever; the waveform is dense after the impact."""
    system = beams.cantilever(elements)
    Omega = beams.OMEGA * np.array([0.8, 1.1, 2.3])
    load = (driven.Force((2 * elements - 2,), (1.0,), 6.0),)
    tau = np.concatenate([np.logspace(-9.0, -2.0, 60), np.linspace(0.01, 1.0, 400)])
    problem = driven.Problem(
        system, Omega, load, outputs=ALL, tau=tau,
        sequence=driven.SYMMETRIC if symmetric else (driven.Impact(0),),
    )  # fmt: skip
    result = driven.solve(problem, driven.plan(problem))
    assert (result.solution_impacts > 0).any()
    return result


@pytest.mark.parametrize("symmetric", [False, True])
@pytest.mark.parametrize("largest", [0, 20_000])
def test_what_dies_may_be_evaluated_once_for_all(
    symmetric: bool, largest: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Motions do not depend on which dying vibrations come from a table, nor on what it knows."""
    shared, mesh = list[int](), along._mesh

    def counted(*given: Any) -> Mesh:
        made = mesh(*given)
        shared.append(made.shared.size)
        return made

    monkeypatch.setattr(along, "_mesh", counted)
    monkeypatch.setattr(along, "PAYS", math.inf)
    monkeypatch.setattr(along, "_FEW", 1)
    once = response(symmetric=symmetric)
    monkeypatch.setattr(along, "_TABLE", largest)
    each = response(symmetric=symmetric)
    whole, none, some, _ = shared
    assert none == 0
    assert 0 < some < whole if largest else some == 0
    for name in ("x_max", "x_min", "rms", "work", "energy_lost", "energy"):
        apart = np.abs(getattr(once, f"solution_{name}") - getattr(each, f"solution_{name}"))
        assert (apart <= 0.5 * getattr(once, f"error_{name}")).all(), name


@pytest.mark.parametrize("symmetric", [False, True])
def test_panels_may_lengthen_as_vibrations_decay(
    symmetric: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Integrals and extremes are those of panels as short as undamped vibrations need."""
    monkeypatch.setattr(along, "PAYS", math.inf)
    nodes, evaluate = list[int](), along.Along.of

    def counted(*given: Any) -> along.Along:
        made = evaluate(*given)
        nodes.append(int(made.nodes.sum()))
        return made

    monkeypatch.setattr(along.Along, "of", counted)
    longer = response(symmetric=symmetric)
    few = sum(nodes)
    monkeypatch.setattr(along, "_DEGREE", math.inf)
    shorter = response(symmetric=symmetric)
    assert few < 0.7 * (sum(nodes) - few)
    for name in ("x_max", "x_min", "rms", "work", "energy_lost"):
        apart = np.abs(getattr(longer, f"solution_{name}") - getattr(shorter, f"solution_{name}"))
        assert (apart <= 0.5 * getattr(shorter, f"error_{name}")).all(), name


@pytest.mark.parametrize("symmetric", [False, True])
def test_extremes_are_those_of_the_waveform(symmetric: bool) -> None:
    result = response(symmetric=symmetric)
    error, size = result.error_x_max, np.abs(result.waveform).max(axis=1)
    above = result.solution_x_max - result.waveform.max(axis=1)
    below = result.waveform.min(axis=1) - result.solution_x_min
    for beyond in (above, below):
        assert (beyond >= -2.0 * error).all()
        assert (beyond <= 2e-3 * size).all()


@pytest.mark.parametrize("symmetric", [False, True])
def test_modes_that_die_take_no_part_in_multipliers(
    symmetric: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of all modes, the others have the same multipliers; theirs are nothing."""
    few = response(symmetric=symmetric)
    monkeypatch.setattr(multipliers, "_GONE", math.inf)
    every = response(symmetric=symmetric)
    for part in ("real", "imaginary"):
        values = [getattr(result, f"multipliers_{part}") for result in (few, every)]
        errors = [getattr(result, f"error_multipliers_{part}") for result in (few, every)]
        assert (np.abs(values[0] - values[1]) <= errors[0] + errors[1]).all()
        assert (errors[0][:, 0] <= 2.0 * errors[1][:, 0]).all()
    assert (few.multipliers_real[few.solution_impacts > 0] == 0.0).any()


def test_losses_are_the_work_of_the_load() -> None:
    result = response()
    apart = np.abs(result.solution_work - result.solution_energy_lost)
    assert (apart <= result.error_work + result.error_energy_lost).all()
    assert (result.error_energy_lost <= 1e-9 * result.solution_energy_lost).all()
