"""Structures damped by ratios, Rayleigh's coefficients, loss factors and dashpots, as users do."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.linalg

import vibroimpact as vi

pytestmark = [
    pytest.mark.needs("compiled kernels"),
    pytest.mark.filterwarnings("ignore::vibroimpact.NeglectedWarning"),
]

SI = {"length": "m", "mass": "kg", "time": "s"}
M, K = np.diag([2.0, 2.0, 1.0]), 1e6 * np.array([[4.0, -2, 0], [-2, 4, -2], [0, -2, 2]])
VALUES, MODES = scipy.linalg.eigh(K, M)
OMEGA = np.sqrt(VALUES)
TIMES = np.linspace(0.0, 0.05, 11)
START = np.array([1e-3, 0.0, 0.0])
STOP = [vi.constraint(2, 1.0)]


def modal(*ratios: float) -> np.ndarray:
    return np.asarray(M @ MODES @ np.diag(2.0 * np.array(ratios) * OMEGA) @ MODES.T @ M)


def rayleigh() -> np.ndarray:
    at = np.array([2 * np.pi * 80, 2 * np.pi * 300])
    alpha, beta = np.linalg.solve(0.5 * np.column_stack([1 / at, at]), [0.01, 0.03])
    return np.asarray(alpha * M + beta * K)


BETWEEN = vi.dashpot(direction={0: 1.0, 1: -1.0}, c=30.0)
W = np.array([1.0, -1.0, 0.0])
CASES: dict[str, tuple[dict[str, Any], np.ndarray]] = {
    "a ratio": ({"damping": 0.02}, modal(0.02, 0.02, 0.02)),
    "ratios": ({"damping": [0.01, 0.02, 0.05]}, modal(0.01, 0.02, 0.05)),
    "coefficients": ({"damping": {"rayleigh": [1.0, 1e-5]}}, M + 1e-5 * K),
    "ratios of Rayleigh's": (
        {"damping": {"rayleigh": {"ratios": [0.01, 0.03], "at": [80.0, 300.0], "unit": "Hz"}}},
        rayleigh(),
    ),
    "a loss factor": (
        {"damping": {"structural": 0.02, "at": 4800.0, "unit": "rpm"}},
        0.02 / (2 * np.pi * 80) * K,
    ),
    "dashpots": (
        {"dashpots": [BETWEEN, vi.dashpot(2, 5.0)]},
        30.0 * np.outer(W, W) + np.diag([0.0, 0.0, 5.0]),
    ),
    "a ratio and a dashpot": (
        {"damping": 0.02, "dashpots": BETWEEN},
        modal(0.02, 0.02, 0.02) + 30.0 * np.outer(W, W),
    ),
    "a matrix and a dashpot": (
        {"C": 10.0 * np.eye(3), "dashpots": BETWEEN},
        10.0 * np.eye(3) + 30.0 * np.outer(W, W),
    ),
}


@pytest.mark.parametrize(("given", "C"), CASES.values(), ids=CASES)
def test_motions_are_those_of_the_exponential_of_the_matrix(
    given: dict[str, Any], C: np.ndarray
) -> None:
    system = vi.system(M, K, STOP, units=SI, **given)
    result = vi.Local().time_history(system, (START, np.zeros(3)), 0.05, t=TIMES, outputs=["x"])
    state = np.block(
        [[np.zeros((3, 3)), np.eye(3)], [-np.linalg.inv(M) @ K, -np.linalg.inv(M) @ C]]
    )
    start = np.concatenate([START, np.zeros(3)])
    expected = np.array([scipy.linalg.expm(state * t) @ start for t in TIMES])[:, :3]
    np.testing.assert_allclose(result.x, expected, atol=1e-14)


def test_the_amplitude_at_resonance_is_that_of_the_ratio() -> None:
    system = vi.oscillator([vi.constraint(0, 1e3)], 2.0, damping=0.05)
    result = vi.Local().periodic_motions(system, [2.0], [vi.drive(0, 1.0)])
    still = result.solution.impacts == 0
    np.testing.assert_allclose(result.solution.x_max[still, 0], 1.0 / (2 * 0.05 * 4.0), rtol=1e-12)


def test_a_law_and_its_matrix_give_the_same_numbers() -> None:
    local, motion = vi.Local(), ((START, np.zeros(3)), 0.05)
    by_law = vi.system(M, K, STOP, damping={"rayleigh": [1.0, 0.25]})
    by_matrix = vi.system(M, K, STOP, M + 0.25 * K)
    law, matrix = (
        local.time_history(s, *motion, t=TIMES, outputs=["x"]) for s in (by_law, by_matrix)
    )
    np.testing.assert_array_equal(law.x, matrix.x)
    assert law.digest != matrix.digest


def test_presets_and_models_are_damped_alike() -> None:
    model = vi.Model(M, K, units=SI)
    assert model.system(STOP, damping=0.02) == vi.Model(M, K, units=SI).system(STOP) | {
        "damping": {"ratio": 0.02}
    }
    local = vi.Local()
    by_preset = vi.chain(4, [vi.constraint(0, 1.0)], damping=[0.01, 0.02, 0.03, 0.04])
    line = 2.0 * np.eye(4) - np.eye(4, k=1) - np.eye(4, k=-1)
    by_matrices = vi.system(
        np.ones(4), line, [vi.constraint(0, 1.0)], damping=[0.01, 0.02, 0.03, 0.04]
    )
    outputs = ["impulse", "stability"]
    one, other = (local.impact_modes(s, [2.5], outputs=outputs) for s in (by_preset, by_matrices))
    np.testing.assert_allclose(one.stability, other.stability, rtol=1e-10)
    for structure in (
        vi.two_mass(STOP[:0], damping=0.1, dashpots=[vi.dashpot(0, 1.0)]),
        vi.double_pendulum([], 2.0, damping=0.1),
    ):
        assert local.natural_frequencies(structure).Omega.size == 2


def test_a_sweep_over_the_ratio() -> None:
    local = vi.Local()
    system = vi.oscillator([vi.constraint(0, 1e3)], 1.0, damping=0.1)
    base = vi.periodic_motions_request(system, [1.0], [vi.drive(0, 1.0)])
    values = [0.01, 0.02, 0.05]
    swept = local.sweep("periodic-motions", base, {"system.damping.ratio": values})
    still = swept.solution.impacts == 0
    np.testing.assert_allclose(swept.solution.x_max[still, 0], 0.5 / np.array(values), rtol=1e-12)
    assert swept.ratio.tolist() == values
    modes = vi.impact_modes_request(system, [1.5])
    plan = local.plan(
        "sweep",
        vi.sweep_request("impact-modes", modes, {"system.damping.ratio": values}),
    )
    assert any("damping.ratio" in skip["what"] or "ratio" in skip["what"] for skip in plan["skips"])
    by_dashpot = vi.oscillator([vi.constraint(0, 1e3)], 1.0, dashpots=vi.dashpot(0, 1.0))
    base = vi.periodic_motions_request(by_dashpot, [1.0], [vi.drive(0, 1.0)])
    swept = local.sweep("periodic-motions", base, {"system.dashpots.0.c": [0.1, 0.2]})
    still = swept.solution.impacts == 0
    np.testing.assert_allclose(swept.solution.x_max[still, 0], [10.0, 5.0], rtol=1e-12)


def test_a_plan_says_what_structural_damping_stands_for() -> None:
    system = vi.system(M, K, STOP, units=SI, damping={"structural": 0.02, "at": 80.0, "unit": "Hz"})
    request = vi.time_history_request(system, (START, np.zeros(3)), 0.05)
    (said,) = (
        skip["why"]
        for skip in vi.Local().plan("time-history", request)["skips"]
        if "do not depend on the frequency" in skip["what"]
    )
    assert "80.0 Hz" in said


def test_a_stored_structure_keeps_its_damping() -> None:
    with vi.Client() as client:
        stored = client.store(vi.system(M, K, STOP, units=SI, damping=0.02))
        motion = ((START, np.zeros(3)), 0.05)
        whole = vi.system(M, K, STOP, units=SI, damping=0.02)
        one, other = (
            client.time_history(s, *motion, t=TIMES, outputs=["x"]) for s in (stored, whole)
        )
        np.testing.assert_array_equal(one.x, other.x)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"C": np.eye(3), "damping": 0.02}, "/system: give C or damping"),
        ({"damping": [0.1, 0.2]}, "/system/damping/ratio: give one ratio, or 3"),
        ({"damping": -0.1}, "/system/damping/ratio: "),
        ({"damping": [0.1, 0.1, -0.1]}, "/system/damping/ratio/2: "),
        ({"damping": {"viscous": 1.0}}, "/system/damping: damping is an object with ratio"),
        ({"damping": {"rayleigh": [1.0]}}, "/system/damping/rayleigh: "),
        ({"damping": {"rayleigh": [1.0, -1.0]}}, "/system/damping/rayleigh/1: "),
        ({"damping": {"rayleigh": {"ratios": [0.1, 0.1]}}}, "/system/damping/rayleigh/at: "),
        (
            {"damping": {"rayleigh": {"ratios": [0.1, 0.1], "at": [1.0, 1.0]}}},
            "/system/damping/rayleigh/at: the two frequencies are equal",
        ),
        ({"damping": {"structural": 0.1}}, "/system/damping/at: "),
        (
            {"damping": {"structural": 0.1, "at": 5.0, "unit": "Hz"}, "units": {**SI, "time": "d"}},
            "/system/damping/unit: Hz needs a unit of time",
        ),
        ({"dashpots": vi.dashpot(3, 1.0)}, "/system/dashpots/0/dofs/0: dof 3"),
        ({"dashpots": vi.dashpot(0, -1.0)}, "/system/dashpots/0/c: "),
    ],
)
def test_what_is_wrong_is_named(given: dict[str, Any], message: str) -> None:
    with pytest.raises(vi.InvalidRequest) as caught:
        vi.Local().natural_frequencies(vi.system(M, K, STOP, **given))
    assert message in str(caught.value)


def test_presets_have_one_damping() -> None:
    both = vi.oscillator([], 1.0, 0.1, damping=0.1)
    with pytest.raises(vi.InvalidRequest, match="give zeta or damping"):
        vi.Local().natural_frequencies(both)
    with pytest.raises(ValueError, match="either a dof or a direction"):
        vi.dashpot(0, 1.0, direction={1: 1.0})
    with pytest.raises(ValueError, match="either a dof or a direction"):
        vi.dashpot(c=1.0)


def test_large_structures_take_rayleigh_damping() -> None:
    large = vi.chain(2000, [vi.constraint(7, 0.1)], damping=0.02)
    with pytest.raises(vi.InvalidRequest, match="Rayleigh"):
        vi.Local().natural_frequencies(large)
    damped = vi.chain(2000, [vi.constraint(7, 0.1)], damping={"rayleigh": [0.0, 0.1]})
    assert vi.Local().natural_frequencies(damped, 2).Omega.size == 2
