"""Reduced models beside whole ones: receptances, flexibilities and motions at their stops."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
import scipy.linalg

import vibroimpact as vi
from tests.client.test_large_models import solid
from tests.client.test_reductions import beam, truss
from vibroimpact.models import cholesky, motion_comparison

FAR = {"stiffness": 1e4, "gap": 1e3}


def receptances(
    model: vi.Model, C: np.ndarray, stops: np.ndarray, forces: np.ndarray, Omega: np.ndarray
) -> np.ndarray:
    """Return those of all degrees of freedom, by full matrices."""
    M, K = model.M.toarray(), model.K.toarray()
    return np.array([stops.T @ np.linalg.solve(K + 1j * w * C - w * w * M, forces) for w in Omega])


def unit(model: vi.Model, *labels: tuple[int, str]) -> np.ndarray:
    return np.eye(model.n)[:, [model.dof(*label) for label in labels]]


def differ(found: np.ndarray, expected: np.ndarray) -> float:
    size = np.abs(expected).max(axis=0)
    return float((np.abs(found - expected) / np.where(size > 0.0, size, 1.0)).max())


STRUCTURES: dict[str, tuple[Any, list[tuple[int, str]], int]] = {
    "cantilever": (lambda: beam(30).fixed([0]), [(30, "z"), (15, "z")], 0),
    "cantilever without rotary mass": (
        lambda: beam(20, lumped=True).fixed([0]), [(20, "z"), (10, "ry")], 0),
    "free beam": (lambda: beam(30), [(30, "z")], 2),
    "free beam, three kept": (lambda: beam(30), [(30, "z"), (0, "z"), (15, "z")], 2),
    "free truss": (lambda: truss(np.random.default_rng(3)), [(3, "x"), (5, "y")], 6),
    "solid": (lambda: solid(6, 5, 4).fixed(range(0, 120, 6)), [(119, "z"), (113, "x")], 0),
    "wholly kept": (lambda: beam(2).fixed([0]), [(node, each) for node in (1, 2)
                                                 for each in ("z", "ry")], 0),
}  # fmt: skip


@pytest.mark.parametrize("large", [False, True])
@pytest.mark.parametrize("name", STRUCTURES)
def test_responses_are_those_of_the_whole_model(
    name: str, large: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Against full matrices: receptances, and flexibilities beside rigid bodies' motions."""
    make, keep, rigid = STRUCTURES[name]
    model = make()
    if large:
        monkeypatch.setattr(cholesky, "LARGE", len(keep) + 5)
    small = vi.reduce(model, keep, modes=0 if name == "wholly kept" else 3, compare=rigid + 2)
    stops = [small.model.constraint(*label, **FAR) for label in keep[:2]]
    first, second = small.Omega[rigid], 1.5 * small.Omega[rigid + 1]
    structure = small.model.system(stops, damping={"rayleigh": [0.02 * first, 0.02 / second]})
    load = [vi.drive({0: 0.5, len(keep) - 1: 2.0} if len(keep) > 1 else 0)]
    compared = small.compare(structure, np.linspace(0.2 * first, second, 30), load)
    assert compared.residual.max() < 1e-7
    places = unit(model, *sorted(keep, key=lambda label: model.dof(*label)))
    forces = places[:, 0] if len(keep) == 1 else 0.5 * places[:, 0] + 2.0 * places[:, -1]
    W = unit(model, *keep[:2])
    F = np.column_stack([W, forces])
    C = 0.02 * first * model.M.toarray() + 0.02 / second * model.K.toarray()
    exact = receptances(model, C, W, F, compared.Omega)
    assert differ(compared.whole_receptance, exact) < 1e-6
    # The reduced model's by its matrices, and what it leaves out.
    c = 0.02 * first * small.model.M.toarray() + 0.02 / second * small.model.K.toarray()
    mine = receptances(small.model, c, small.T.T @ W, small.T.T @ F, compared.Omega)
    assert differ(compared.receptance, mine) < 1e-9
    np.testing.assert_allclose(
        compared.error, np.abs(mine - exact) / np.abs(exact).max(axis=0), rtol=0, atol=2e-6
    )
    # Static, without rigid bodies: forces are carried by their inertia.
    assert (small.T @ small.motions).shape == (model.n, rigid)
    static = W.T @ at_rest(model, small.T @ small.motions, F)
    assert differ(compared.whole_flexibility, static) < 1e-6
    reduced = W.T @ small.T @ at_rest(small.model, small.motions, small.T.T @ F)
    assert differ(compared.flexibility, reduced) < 1e-6
    # Kept degrees of freedom are exact at rest; inertia deflects the others.
    assert (compared.flexibility_error.max() < 1e-7) == (rigid == 0)


def at_rest(model: vi.Model, R: np.ndarray, F: np.ndarray) -> np.ndarray:
    """Return the static displacements, the elastic ones of a structure with rigid-body modes R."""
    M, K = model.M.toarray(), model.K.toarray()
    P = np.eye(model.n)
    if R.shape[1]:
        P = P - R @ np.linalg.solve(R.T @ M @ R, R.T @ M)
    x: np.ndarray = P @ np.linalg.lstsq(K, P.T @ F, rcond=1e-12)[0]
    return x


DAMPINGS: dict[str, Any] = {
    "none": {},
    "ratio": {"damping": 0.02},
    "ratios": {"damping": [0.01, 0.02, 0.03, 0.01, 0.05]},
    "rayleigh": {"damping": {"rayleigh": {"ratios": [0.01, 0.02], "at": [4e3, 3e4],
                                          "unit": "Hz"}}},
    "structural": {"damping": {"structural": 0.03, "at": 3e5, "unit": "rpm"}},
    "dashpot": {"damping": {"rayleigh": [0.3, 0.0]}, "dashpots": [vi.dashpot(1, 0.8),
                                                vi.dashpot(direction={0: 1.0, 1: -0.5}, c=0.2)]},
}  # fmt: skip


@pytest.mark.needs("processes")
@pytest.mark.parametrize("name", [*DAMPINGS, "own matrix", "other matrix"])
def test_the_damping_is_that_of_computations(name: str) -> None:
    """Of the reduced model, by its motions without contact; that of the whole reduces to it."""
    model = beam(12).fixed([0])
    if name == "own matrix":
        C = 1e-3 * model.K
        C[3, 3] += 0.7
        model = vi.Model(model.M, model.K, C, model.labels)
    units = {"length": "mm", "mass": "t", "time": "ms"}
    model = vi.Model(model.M, model.K, model.C, model.labels, units=units)
    small = vi.reduce(model, [(12, "z"), (6, "z")], modes=3)
    structure: Any = small.model.system([small.model.constraint(12, "z", **FAR)])
    if name == "other matrix":
        structure = {**structure, "C": np.diag([0.1, 0.2, 0.03, 0.01, 0.02]).tolist()}
    elif name in DAMPINGS:
        structure = small.model.system([small.model.constraint(12, "z", **FAR)], **DAMPINGS[name])
    hertz = 1e3 * np.array([2.0, 7.0, 21.0])  # periods of some tenths of 1 ms
    force = [vi.drive(small.model.dof(6, "z"), 1.0)]
    compared = small.compare(structure, hertz, force, unit="Hz")
    np.testing.assert_allclose(compared.Omega, 2e-3 * np.pi * hertz, rtol=1e-14)
    motions = vi.Local().periodic_motions(
        structure, hertz, force, unit="Hz", outputs=["exists", "extremes"],
        dofs=[small.model.dof(12, "z")],
    )  # fmt: skip
    amplitude = np.sqrt(2.0) * motions.solution.rms[motions.solution.contacts == 0, 0]
    np.testing.assert_allclose(np.abs(compared.receptance[:, 0, 1]), amplitude, rtol=1e-7)
    assert compared.error.max() < 0.01


@pytest.mark.parametrize("quantity", ["acceleration", "displacement"])
def test_a_base_moves_both_models(quantity: str) -> None:
    """The force by unit acceleration is -M r, of all that moves, in the whole model."""
    model = beam(15).fixed([0])
    small = vi.reduce(model, [(15, "z")], modes=5)
    stop = small.model.constraint(15, "z", **FAR)
    structure = small.model.system([stop], damping={"rayleigh": [0.5, 0.0]}, base="z")
    compared = small.compare(structure, np.linspace(5.0, 90.0, 40), [vi.drive(base=quantity)])
    r = model.influence("z")
    F = -(model.M @ r)[:, np.newaxis]
    exact = receptances(model, 0.5 * model.M.toarray(), unit(model, (15, "z")), F, compared.Omega)[
        :, :, 0
    ]
    assert differ(compared.whole_receptance[:, :, 1], exact) < 1e-7
    assert compared.error.max() < 1e-3
    assert compared.forces == ["stop 0", "load 0"]
    # An influence of the caller's own is expanded.
    own: Any = {**structure, "influence": np.eye(small.model.n)[0].tolist()}
    moved = small.compare(own, compared.Omega, [vi.drive(base=quantity)])
    F = -(model.M @ small.T[:, :1])
    exact = receptances(model, 0.5 * model.M.toarray(), unit(model, (15, "z")), F, compared.Omega)[
        :, :, 0
    ]
    assert differ(moved.whole_receptance[:, :, 1], exact) < 1e-7


def test_a_stop_between_two_nodes_is_compared() -> None:
    model = beam(16).fixed([0])
    small = vi.reduce(model, [(16, "z"), (8, "z")], modes=2)
    stop = small.model.constraint(16, "z", against=8, **FAR)
    compared = small.compare(small.model.system([stop]), [13.0, 71.0, 160.0])
    w = unit(model, (16, "z")) - unit(model, (8, "z"))
    exact = receptances(model, np.zeros((model.n, model.n)), w, w, compared.Omega)
    assert differ(compared.whole_receptance, exact) < 1e-6
    half = small.half().compare(small.half().model.system([stop]), compared.Omega)
    assert differ(half.whole_receptance, exact) < 1e-6
    assert half.error.max() > 2.0 * compared.error.max()


def bouncing(small: Any, **options: Any) -> Any:
    """Return the comparison of a beam that meets a pad at its end, driven in its middle."""
    stop = small.model.constraint(
        30, "z", {"lower": None, "upper": 1e-3}, stiffness=2e4, damping=1.0
    )
    law = {"rayleigh": {"ratios": [0.01, 0.01], "at": [27.5, 470.0]}}
    structure = small.model.system([stop], damping=law)
    load = [vi.drive(small.model.dof(15, "z"), 4.0)]
    return small.compare(structure, np.linspace(5.0, 700.0, 30), load, at=55.0, **options)


@pytest.mark.needs("processes")
@pytest.mark.parametrize("modes", [1, 4])
def test_a_driven_motion_is_that_of_the_whole_model(
    modes: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the subspace of its responses as on all degrees of freedom, and by hand on these."""
    model = beam(30).fixed([0])
    small = vi.reduce(model, [(30, "z"), (15, "z")], modes=modes)
    own = bouncing(small).motion
    assert own.of == 60
    monkeypatch.setattr(motion_comparison, "_FEW", 0)
    subspace = bouncing(small).motion
    assert subspace.of < 30
    for name in ("duration", "peak_force", "impulse"):
        true, found = (each.whole.contact[name] for each in (own, subspace))
        np.testing.assert_allclose(found, true, rtol=1e-5)
    # The same motion by a request for the whole model.
    stop = model.constraint(30, "z", {"lower": None, "upper": 1e-3}, stiffness=2e4, damping=1.0)
    law = {"rayleigh": {"ratios": [0.01, 0.01], "at": [27.5, 470.0]}}
    load = [vi.drive(model.dof(15, "z"), 4.0)]
    whole = vi.Local().periodic_motions(model.system([stop], damping=law), [55.0], load)
    assert whole.solution.exists.sum() == 1
    there = whole.solution.exists[whole.contact.solution]
    force = whole.contact.peak_force[there]
    mine = own.reduced.contact.peak_force[own.reduced.solution.exists[own.reduced.contact.solution]]
    np.testing.assert_allclose(own.change["contact.peak_force"], np.abs(mine - force), rtol=1e-6)
    assert own.relative("contact.peak_force") == own.change["contact.peak_force"][0] / force[0]
    assert (own.relative("contact.peak_force") < 0.02) == (modes == 4)
    assert "1 motion, duration differs by up to" in str(bouncing(small))


@pytest.mark.needs("processes")
def test_other_motions_are_said_to_be_others() -> None:
    """Guyan's reduction is too stiff: it does not strike where the whole beam does."""
    model = beam(30).fixed([0])
    small = vi.reduce(model, [(30, "z"), (15, "z")], modes=0)
    stop = small.model.constraint(30, "z", {"lower": None, "upper": 0.01}, restitution=0.5)
    structure = small.model.system([stop], damping={"rayleigh": [0.5, 0.0]})
    resonance = float(np.sqrt(scipy.linalg.eigh(model.K.toarray(), model.M.toarray(),
                                                eigvals_only=True)[2]))  # fmt: skip
    load = [vi.drive(small.model.dof(30, "z"), 1.0)]
    compared = small.compare(structure, [resonance], load, at=resonance, client=vi.Local())
    motion = compared.motion
    assert motion is not None
    counts = [int(each.solution.exists.sum()) for each in (motion.reduced, motion.whole)]
    assert counts[0] != counts[1]
    assert not motion.change
    assert f"{counts[1]} of the whole model" in str(motion)


def test_it_can_be_read_and_drawn() -> None:
    model = beam(12).fixed([0])
    si = {"length": "m", "mass": "kg", "time": "s"}
    model = vi.Model(model.M, model.K, labels=model.labels, units=si)
    small = vi.reduce(model, [(12, "z"), (6, "z")], modes=2, compare=2)
    structure = small.model.system([small.model.constraint(12, "z", **FAR)], damping=0.02)
    compared = pickle.loads(pickle.dumps(small)).compare(structure, load=[vi.drive(1)], unit="Hz")
    # The default ends at the highest natural frequency that was compared.
    assert compared.Omega.size == 100
    assert compared.Omega[-1] == pytest.approx(small.Omega[-1])
    worst = 100.0 * compared.error.max()
    assert f"differ by up to {worst:.2g} % of their largest" in repr(compared)
    assert repr(compared).startswith("<Comparison: 4 for 24 degrees of freedom; ")
    assert compared._repr_html_().count("<tr>") == 3
    ax = compared.plot(force="load 0")
    assert ax.get_xlabel() == "frequency (Hz)"
    lines = {line.get_label(): line for line in ax.lines}
    assert list(lines) == ["whole model, 24 degrees of freedom", "reduced, 4"]
    drawn = lines["reduced, 4"]
    np.testing.assert_allclose(drawn.get_xdata()[-1], small.Omega[-1] / (2 * np.pi))
    np.testing.assert_allclose(drawn.get_ydata(), np.abs(compared.receptance[:, 0, 1]))


def test_what_cannot_be_compared_is_said() -> None:
    model = beam(12).fixed([0])
    small = vi.reduce(model, [(12, "z")], modes=2)
    stop = small.model.constraint(12, "z", **FAR)
    structure: Any = small.model.system([stop])
    with pytest.raises(ValueError, match="there is no node 99"):
        small.model.constraint(99, "z", **FAR)
    wrong: list[tuple[str, Any, dict[str, Any]]] = [
        ("M is not that of the reduced model", model.system([stop]), {}),
        ("K is not that of the reduced model", {**structure, "K": structure["M"]}, {}),
        ("M is not that of the reduced model", vi.chain(3, [stop]), {}),
        ("it has no stops", small.model.system([]), {}),
        ("the static load", small.model.system([stop], {(12, "z"): 1.0}), {}),
        ("stop 0: degree of freedom 1 is a mode of the reduction",
         small.model.system([vi.constraint(1, **FAR)]), {}),
        ("stop 0: there is no degree of freedom 3",
         small.model.system([vi.constraint(3, **FAR)]), {}),
        ("load 0: degree of freedom 2 is a mode", structure, {"load": [vi.drive(2)]}),
        ("dashpot 0: degree of freedom 1 is a mode",
         small.model.system([stop], dashpots=vi.dashpot(1, 0.1)), {}),
        ("load: the base moves, but the structure has no base=", structure,
         {"load": [vi.drive(base="acceleration")]}),
        ("frequency: give positive numbers", structure, {"frequency": [0.0, 1.0]}),
        ("frequency needs values, or start, stop and num", structure,
         {"frequency": {"start": 1.0, "stop": 2.0, "step": 0.1}}),
        ("have no value in 'kHz'", structure, {"unit": "kHz"}),
        ("periods: only motions take it", structure, {"periods": 2}),
    ]  # fmt: skip
    for told, document, options in wrong:
        with pytest.raises(ValueError, match=told):
            small.compare(document, **{"frequency": [1.0], **options})
    none = vi.reduce(model, [(12, "z")], modes=2, compare=0)
    with pytest.raises(ValueError, match="no natural frequency was compared"):
        none.compare(structure)
    with pytest.raises(ValueError, match="does not have its whole model"):
        vi.models.Reduction(small.model, small.T, none.Omega, none.error).compare(structure)


def test_rigid_stops_of_large_models_have_no_motion_to_compare(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(motion_comparison, "_FEW", 10)
    small = vi.reduce(beam(12).fixed([0]), [(12, "z")], modes=2)
    structure = small.model.system([small.model.constraint(12, "z", 1e-3)])
    with pytest.raises(ValueError, match="at: what happens at rigid stops has no limit"):
        small.compare(structure, [1.0], [vi.drive(0)], at=1.0)


def test_ratios_need_masses_of_the_kept_degrees_of_freedom() -> None:
    K = np.array([[3.0, -1.0, -1.0], [-1.0, 2.0, 0.0], [-1.0, 0.0, 2.0]])
    own = vi.reduce(vi.Model(np.diag([1.0, 1.0, 0.0]), K), [(0, "x"), (2, "x")])
    structure = own.model.system([own.model.constraint(0, **FAR)], damping=0.02)
    with pytest.raises(ValueError, match=r"has no mass.*give Rayleigh's damping"):
        own.compare(structure, [0.3])


def test_an_undamped_resonance_and_an_unstable_structure_have_no_receptance() -> None:
    model = vi.Model(np.eye(2), np.diag([4.0, 9.0]))
    small = vi.reduce(model, [(0, "x"), (1, "x")])
    structure = small.model.system([small.model.constraint(0, **FAR)])
    with pytest.raises(ValueError, match=r"Omega = 2.0 is a natural frequency without damping"):
        small.compare(structure, [1.0, 2.0])
    K = np.diag([1.0, -1.0, 3.0]) + 0.1
    unstable = vi.reduce(vi.Model(np.eye(3), K), [(0, "x")], modes=2)
    structure = unstable.model.system([unstable.model.constraint(0, **FAR)])
    with pytest.raises(ValueError, match="not positive semidefinite"):
        unstable.compare(structure, [0.3])
