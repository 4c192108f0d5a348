"""Structures on a base that moves, and unbalances, against integrations in the absolute frame."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.integrate
import scipy.linalg

import vibroimpact as vi

pytestmark = [
    pytest.mark.needs("compiled kernels"),
    pytest.mark.filterwarnings("ignore::vibroimpact.NeglectedWarning"),
]

K = np.array([[4.0, -2.0, 0.0], [-2.0, 4.0, -2.0], [0.0, -2.0, 2.0]])
M = np.diag([2.0, 2.0, 1.0])
C = 0.05 * K
R = np.array([1.0, 1.0, 1.0])
"""The base holds the first mass by a spring and a damper, so that K R is only a force on it."""
FAR = [vi.constraint(2, 50.0)]
WALL = [vi.constraint(2, {"lower": None, "upper": 0.5}, 0.8)]


def system(constraints: Any, **more: Any) -> Any:
    return vi.system(M, K, constraints, C, **{"influence": R, **more})


def amplitude(quantity: str, turning: float) -> complex:
    """Return the acceleration of a base whose given quantity has the amplitude 1."""
    return {"acceleration": 1.0, "velocity": 1j * turning, "displacement": -(turning**2) + 0j}[
        quantity
    ]


@pytest.mark.parametrize("quantity", ["acceleration", "velocity", "displacement"])
def test_motions_are_those_of_the_absolute_frame(quantity: str) -> None:
    frequency, phase, end = 0.9, 0.4, 12.0
    load = vi.base_vibration(quantity, 0.3, frequency, phase)  # type: ignore[arg-type]
    x, v = np.array([0.1, 0.0, -0.1]), np.array([0.0, 0.2, 0.0])
    times = np.linspace(0.0, end, 13)
    result = vi.Local().time_history(
        system(FAR), (x, v), end, t=times, load=[load], outputs=["x", "v"]
    )
    # The displacement u of the base, its acceleration integrated twice.
    u = 0.3 * np.exp(1j * phase) * amplitude(quantity, frequency) / (1j * frequency) ** 2

    def base(t: float) -> tuple[float, float]:
        turned = u * np.exp(1j * frequency * t)
        return turned.real, (1j * frequency * turned).real

    def rates(t: float, state: np.ndarray) -> np.ndarray:
        at, moving = base(t)
        force = -K @ (state[:3] - R * at) - C @ (state[3:] - R * moving)
        return np.concatenate([state[3:], np.linalg.solve(M, force)])

    at, moving = base(0.0)
    start = np.concatenate([x + R * at, v + R * moving])
    absolute = scipy.integrate.solve_ivp(
        rates, (0.0, end), start, "DOP853", times, rtol=1e-12, atol=1e-13
    ).y.T
    moved = np.array([base(t) for t in times])
    np.testing.assert_allclose(result.x, absolute[:, :3] - np.outer(moved[:, 0], R), atol=1e-10)
    np.testing.assert_allclose(result.v, absolute[:, 3:] - np.outer(moved[:, 1], R), atol=1e-10)


@pytest.mark.parametrize("quantity", ["acceleration", "velocity", "displacement"])
@pytest.mark.parametrize("harmonic", [1, 2])
def test_responses_are_those_of_the_dynamic_stiffness(quantity: str, harmonic: int) -> None:
    drive = vi.drive(base=quantity, amplitude=0.3, harmonic=harmonic, phase=0.4)
    frequencies, tau = np.array([0.5, 0.9, 1.7]), np.array([0.0, 0.3])
    result = vi.Local().periodic_motions(system(FAR), frequencies, [drive], tau=tau)
    assert result.solution.Omega.tolist() == frequencies.tolist()
    for row, Omega in enumerate(frequencies):
        turning = harmonic * Omega
        acceleration = 0.3 * np.exp(0.4j) * amplitude(quantity, turning)
        dynamic = K - turning**2 * M + 1j * turning * C
        X = np.linalg.solve(dynamic, -M @ R * acceleration)
        shown = np.real(np.outer(np.exp(2j * np.pi * harmonic * tau), X))
        np.testing.assert_allclose(result.waveform[row], shown, atol=1e-13)
        np.testing.assert_allclose(result.solution.x_max[row], np.abs(X), rtol=1e-12)
        V = 1j * turning * X
        lost = np.pi / Omega * (V.conj() @ C @ V).real
        np.testing.assert_allclose(result.solution.energy_lost[row], lost, rtol=1e-12)
        np.testing.assert_allclose(result.solution.work[row], lost, rtol=1e-12)
        assert abs(result.solution.work[row] - lost) <= result.error.solution.work[row] + 1e-14


def same(one: Any, other: Any, rows: np.ndarray) -> None:
    """Compare the solutions at one frequency of a grid with those of a request of their own."""
    for name in ("work", "energy_lost", "stability", "x_max"):
        mine = getattr(one.solution, name)[rows]
        np.testing.assert_allclose(mine, getattr(other.solution, name), rtol=1e-9, atol=1e-12)
    struck = np.isin(one.impact.solution, np.flatnonzero(rows))
    for name in ("phase", "momentum", "velocity"):
        mine = getattr(one.impact, name)[struck]
        np.testing.assert_allclose(mine, getattr(other.impact, name), rtol=1e-10)


@pytest.mark.parametrize(
    "sequence", [None, [(0, "upper"), (0, "upper")]], ids=["closed form", "search"]
)
def test_an_unbalance_is_a_force_at_each_frequency(sequence: Any) -> None:
    grid = [0.5, 0.6, 0.7]
    more: dict[str, Any] = {}
    if sequence is not None:
        more = {"sequence": sequence, "periods": 2, "phases": [[1.0, 7.0]]}
    local = vi.Local()
    drive = vi.drive(1, 0.9, phase=0.2, scale="Omega2")
    result = local.periodic_motions(system(WALL), grid, [drive], **more)
    for place, Omega in enumerate(grid):
        force = vi.drive(1, 0.9 * Omega**2, phase=0.2)
        alone = local.periodic_motions(system(WALL), [Omega], [force], **more)
        if sequence is None or place == 0:  # a search starts from the frequency before
            same(result, alone, result.solution.frequency_index == place)
    assert result.impact.momentum.size


def test_branches_of_an_unbalance_lie_on_its_motions() -> None:
    local = vi.Local()
    drive = [vi.drive(1, 0.9, scale="Omega2")]
    base = vi.periodic_motions_request(
        system(WALL), [0.5], drive, outputs=["exists", "extremes", "energy"]
    )
    result = local.branches(base, "frequency.values.0", 0.5, 0.8)
    rows = np.flatnonzero(result.solution.impacts == 1)[::7]
    assert rows.size > 2
    for row in rows:
        Omega = float(result.solution.parameter[row])
        force = [vi.drive(1, 0.9 * Omega**2)]
        alone = local.periodic_motions(system(WALL), [Omega], force)
        momentum = result.impact.momentum[result.impact.solution == row][0]
        assert np.abs(alone.impact.momentum - momentum).min() < 1e-8 * abs(momentum)


def test_attractors_of_a_moving_base_are_those_of_its_forces() -> None:
    states = np.zeros((2, 3)), np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.1]])
    more = {"settle": 60, "observe": 40, "outputs": ["section"]}
    local = vi.Local()
    by_base = local.attractors(
        system(WALL), 0.6, [vi.drive(base="displacement", amplitude=0.5)], *states, **more
    )
    # M R u'' of three masses, in phase with the displacement.
    forces = [vi.drive(dof, 0.5 * 0.6**2 * float(mass)) for dof, mass in enumerate(np.diagonal(M))]
    by_forces = local.attractors(system(WALL), 0.6, forces, *states, **more)
    assert by_base.attractor.nature.tolist() == by_forces.attractor.nature.tolist()
    np.testing.assert_allclose(by_base.attractor.x, by_forces.attractor.x, atol=1e-9)


def test_samples_of_the_acceleration_use_the_influence() -> None:
    rng = np.random.default_rng(1)
    samples = rng.normal(size=30)
    start = (np.zeros(3), np.zeros(3))
    more: Any = {"t": 9, "outputs": ["x"]}
    local = vi.Local()
    one, other = (
        local.time_history(
            system(FAR), start, 10.0, load=[vi.base_motion(base, samples, interval=0.5)], **more
        )
        for base in ("acceleration", R)
    )
    np.testing.assert_array_equal(one.x, other.x)


def test_effective_masses_are_those_of_the_base() -> None:
    local = vi.Local()
    by_base = local.natural_frequencies(system(FAR), outputs=["effective_mass"])
    by_direction = local.natural_frequencies(
        vi.system(M, K, FAR), directions=R, outputs=["effective_mass"]
    )
    np.testing.assert_array_equal(by_base.effective_mass, by_direction.effective_mass)
    np.testing.assert_allclose(by_base.effective_mass.sum(), 5.0, rtol=1e-14)


def test_sweeps_move_the_base_with_the_masses_of_their_points() -> None:
    base = vi.periodic_motions_request(
        system(FAR), [0.9], [vi.drive(base="acceleration", amplitude=1.0)]
    )
    local = vi.Local()
    swept = local.sweep("periodic-motions", base, {"system.M.2.2": [1.0, 3.0]})
    for place, mass in enumerate((1.0, 3.0)):
        heavy = np.diag([2.0, 2.0, mass])
        X = np.linalg.solve(K - 0.81 * heavy + 0.9j * C, heavy @ R)
        np.testing.assert_allclose(swept.solution.x_max[place], np.abs(X), rtol=1e-12)


def test_an_influence_may_vary_and_is_kept_with_what_is_stored() -> None:
    drive = [vi.drive(base="acceleration", amplitude=1.0)]
    base = vi.periodic_motions_request(system(FAR), [0.9], drive)
    swept = vi.Local().sweep("periodic-motions", base, {"system.influence.0": [0.0, 1.0]})
    for place, r in enumerate((0.0, 1.0)):
        X = np.linalg.solve(K - 0.81 * M + 0.9j * C, M @ [r, 1.0, 1.0])
        np.testing.assert_allclose(swept.solution.x_max[place], np.abs(X), rtol=1e-12)
    with vi.Client() as client:
        stored = client.store(system(FAR))
        one, other = (client.periodic_motions(each, [0.9], drive) for each in (stored, system(FAR)))
        np.testing.assert_array_equal(one.solution.x_max, other.solution.x_max)


def test_a_model_knows_the_influence_of_its_directions() -> None:
    labels = [(1, "x"), (1, "z"), (2, "z")]
    model = vi.Model(M, K, labels=labels)
    assert model.influence("z").tolist() == [0.0, 1.0, 1.0]
    assert model.system(FAR, base="x")["influence"] == [1.0, 0.0, 0.0]
    with pytest.raises(ValueError, match="there are x, z"):
        model.influence("y")


SHAKEN = vi.base_vibration("velocity", 1.0, 1.0)
HISTORY = {"initial": {"x": [0, 0, 0], "v": [0, 0, 0]}, "t_end": 1.0}
DRIVEN = {"frequency": {"values": [1.0]}}


@pytest.mark.parametrize(
    ("kind", "fields", "structure", "message"),
    [
        (
            "time-history", {**HISTORY, "load": [SHAKEN]},
            {"influence": None}, "/load/0/base: the system needs its influence",
        ),
        (
            "time-history",
            {**HISTORY, "load": [SHAKEN, vi.harmonic(7, 1.0, 1.0)]},
            {}, "/load/1/dof: 7 is not below 3",
        ),
        (
            "time-history", {**HISTORY, "load": [{"base": "jerk", "amplitude": 1, "frequency": 1}]},
            {}, "/load/0/base: ",
        ),
        (
            "time-history", {**HISTORY, "load": [{"base": "velocity", "amplitude": 1}]},
            {}, "/load/0/frequency: ",
        ),
        (
            "time-history",
            {**HISTORY, "load": [{"base": [1, 1], "acceleration": [0, 1], "interval": 1}]},
            {}, "/load/0/base: 2 numbers for 3",
        ),
        (
            "periodic-motions", {**DRIVEN, "load": [vi.drive(base="velocity")]},
            {"influence": None}, "/load/0/base: the system needs its influence",
        ),
        (
            "periodic-motions", {**DRIVEN, "load": [vi.drive(0, base="velocity")]},
            {}, "/load/0: give one of dof, direction and base",
        ),
        (
            "periodic-motions", {**DRIVEN, "load": [vi.drive(base="velocity", scale="Omega2")]},
            {}, "/load/0: the motion of a base has no scale",
        ),
        (
            "periodic-motions", {**DRIVEN, "load": [vi.drive(0, scale="Omega")]},
            {}, "/load/0/scale: ",
        ),
        (
            "periodic-motions", {**DRIVEN, "load": [vi.drive(0, scale="Omega2"), vi.drive(1)]},
            {}, "/load/1: another term of this harmonic",
        ),
        ("natural-frequencies", {}, {"influence": [1.0]}, "/system/influence: the influence"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(
    kind: Any, fields: dict[str, Any], structure: dict[str, Any], message: str
) -> None:
    request: Any = {"system": system(FAR, **structure), **fields}
    with pytest.raises(vi.InvalidRequest) as caught:
        vi.Local().compute(kind, request)
    assert message in str(caught.value)
