"""Stops on reduced models, in series with the flexibility that the reductions lack there.

The table of the documents is computed here.
"""

from __future__ import annotations

import copy
import json
import pickle
from functools import partial
from typing import Any

import numpy as np
import pytest
import scipy.linalg

import vibroimpact as vi
import vibroimpact.models
from tests.client.test_reductions import beam, truss
from vibroimpact.models import cholesky

pytestmark = pytest.mark.needs("processes")

Place = tuple[int, str]


def plate(n: int = 11) -> vi.Model:
    """Return a plate of sides 1 and 0.8 on simple supports, by finite differences."""
    A = (n + 1) ** 2 * (2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    bent = np.kron(A, np.eye(n)) + np.kron(np.eye(n), A / 0.64)
    return vi.Model(np.eye(n * n), bent @ bent, labels=[(node, "z") for node in range(n * n)])


def coordinate(model: vi.Model, *places: Place) -> np.ndarray:
    return np.eye(model.n)[:, [model.dof(*place) for place in places]]


def of_modes(model: vi.Model, W: np.ndarray, kept: int) -> np.ndarray:
    """Return the flexibility of the natural modes from `kept` on, each computed."""
    squares, shapes = scipy.linalg.eigh(model.K.toarray(), model.M.toarray())
    rows = W.T @ shapes[:, kept:]
    return np.asarray((rows / squares[kept:]) @ rows.T)


STRUCTURES: dict[str, tuple[Any, list[Place], int]] = {
    "cantilever": (lambda: beam(20).fixed([0]), [(20, "z"), (13, "z"), (5, "ry")], 0),
    "plate": (plate, [(49, "z"), (50, "z")], 0),
    "free beam": (lambda: beam(20), [(20, "z"), (8, "z")], 2),
    "free body in space": (lambda: truss(np.random.default_rng(3)), [(3, "x"), (4, "y")], 6),
}


@pytest.mark.parametrize("large", [False, True])
@pytest.mark.parametrize("name", STRUCTURES)
def test_it_is_the_flexibility_of_the_modes_that_are_left_out(
    name: str, large: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    make, places, rigid = STRUCTURES[name]
    model = make()
    if large:
        monkeypatch.setattr(cholesky, "LARGE", 10)
    reduced = vi.reduce(model, [], modes=5)
    W = coordinate(model, *places)
    for each, modes in ((reduced, 5), (reduced.half(), 2)):
        small = each.model
        delta = small.residual_flexibility([small.constraint(*place) for place in places])
        expected = of_modes(model, W, rigid + modes)
        assert np.abs(delta - expected).max() < 1e-8 * np.abs(expected).max()
        assert (delta == delta.T).all()
    small, (node, direction), (other, _) = reduced.model, *places[:2]
    between = small.constraint(node, {direction: 0.6}, against=other)
    w = 0.6 * (coordinate(model, (node, direction)) - coordinate(model, (other, direction)))
    expected = of_modes(model, w, rigid + 5)
    np.testing.assert_allclose(small.residual_flexibility([between]), expected, rtol=1e-7)


def test_kept_places_of_a_supported_structure_have_all_of_it() -> None:
    model = beam(20).fixed([0])
    small = vi.reduce(model, [(20, "z"), (7, "z")], modes=3).model
    stops = [small.constraint(20, "z", 1e-3, stiffness=1e3), vi.constraint(1, 1e-3, stiffness=1e3)]
    assert not small.residual_flexibility(stops).any()
    stops.append(small.constraint(13, "z", 1e-3, stiffness=1e3))
    delta = small.residual_flexibility(stops)
    W = coordinate(model, (13, "z"))
    rows = [small.weights(13, "z").get(dof, 0.0) for dof in range(small.n)]
    static = np.linalg.inv(model.K.toarray())
    lacking = W.T @ static @ W - rows @ np.linalg.solve(small.K.toarray(), rows)
    np.testing.assert_allclose(delta[2, 2], lacking, rtol=1e-6)
    assert np.count_nonzero(delta) == 1
    # With rigid stops and damped ones, too, which need none there.
    damped = small.constraint(20, "z", 1e-3, stiffness=1e3, damping=1.0)
    given = [small.constraint(7, "z", 1e-3), damped]
    assert small.system(given, residual_flexibility=True) == small.system(given)


def test_kept_places_of_a_free_body_lack_what_its_inertia_bends() -> None:
    """Of a free beam kept at its end, and of rotations without mass, which all follow."""
    model = beam(20)
    reduced = vi.reduce(model, [(20, "z")], modes=2)
    W = coordinate(model, (20, "z"))
    whole = of_modes(model, W, 2)
    squares, shapes = scipy.linalg.eigh(reduced.model.K.toarray(), reduced.model.M.toarray())
    small = (shapes[0, 2:] ** 2 / squares[2:]).sum()
    delta = reduced.model.residual_flexibility([vi.constraint(0, 1.0, stiffness=1.0)])
    np.testing.assert_allclose(delta, whole - small, rtol=1e-6)
    assert 0.0 < delta[0, 0] < 0.01 * small
    lumped = beam(20, lumped=True).fixed([0])
    condensed = vi.condense(lumped).model
    turn = condensed.residual_flexibility([condensed.constraint(9, "ry", 0.1, stiffness=1.0)])
    rows = [condensed.weights(9, "ry").get(dof, 0.0) for dof in range(condensed.n)]
    static = np.linalg.inv(lumped.K.toarray())[lumped.dof(9, "ry"), lumped.dof(9, "ry")]
    lacking = static - rows @ np.linalg.solve(condensed.K.toarray(), rows)
    np.testing.assert_allclose(turn, [[lacking]], rtol=1e-6)


DRIVEN: dict[str, tuple[vi.Model, Place, Place, float]] = {
    "cantilever": (beam(20).fixed([0]), (20, "z"), (12, "z"), 10.0),
    "plate": (plate(), (49, "z"), (80, "z"), 10.0),
}
"""Structures, places of a stop and of a drive, stiffness of the stop relative to the structure."""
TABLE = {
    "cantilever": {
        3: (0.224955, 0.225723, 0.225427),
        5: (0.225545, 0.225715, 0.225697),
        8: (0.225674, 0.225715, 0.225714),
        12: (0.225703, 0.225715, 0.225715),
        20: (0.225713, 0.225715, 0.225715),
        40: (0.225715, 0.225715, 0.225715),
    },
    "plate": {
        5: (0.193088, 0.270457, 0.236307),
        8: (0.243691, 0.272233, 0.277155),
        12: (0.246928, 0.272271, 0.279042),
        20: (0.257755, 0.272894, 0.272588),
        40: (0.263724, 0.272848, 0.273330),
        121: (0.272988, 0.272988, 0.272988),
    },
}
"""Degrees of freedom -> durations in periods: natural modes, these with their residual flexibility,
and the stop kept beside modes with it held, as in docs. The last rows are the whole structures."""


def duration(name: str, small: vi.Model, **options: Any) -> float:
    """Return how long the contact of the stable driven motion lasts, in periods."""
    model, stop, drive, stiff = DRIVEN[name]
    static, Omega = np.linalg.inv(model.K.toarray()), 1.2 * model.natural(1)[0]
    at, by = model.dof(*stop), model.dof(*drive)
    limits = {"lower": None, "upper": 0.5 * static[at, by]}
    limiter = small.constraint(*stop, limits, stiffness=stiff / static[at, at])
    result = vi.Local().periodic_motions(
        small.system([limiter], damping=0.05, **options), [Omega],
        [vi.drive(small.weights(*drive))], outputs=["exists", "stability"],
    )  # fmt: skip
    exists = result.solution.exists & (result.solution.contacts == 1)
    (row,) = np.flatnonzero(exists & (result.solution.stability < 1.0))
    return float(result.contact.duration[result.contact.solution == row][0] * Omega / (2 * np.pi))


@pytest.mark.parametrize("name", TABLE)
def test_few_modes_strike_like_the_whole_structure(name: str) -> None:
    model, stop, _, _ = DRIVEN[name]
    whole, stated = duration(name, model), dict(TABLE[name])
    last, *_ = stated.pop(model.n)
    assert abs(last - whole) < 6e-7
    errors = {}
    for count, row in stated.items():
        modes, kept = vi.reduce(model, [], count).model, vi.reduce(model, [stop], count - 1).model
        computed = np.array([
            duration(name, modes),
            duration(name, modes, residual_flexibility=True),
            duration(name, kept),
        ])  # fmt: skip
        assert np.abs(computed - row).max() < 6e-7
        errors[count] = np.abs(computed - whole)
    assert all(error[1] < 0.2 * error[0] for error in errors.values())
    assert errors[20][1] < 0.03 * errors[20][0]


def test_a_result_says_what_half_of_the_modes_change_beside_their_flexibility() -> None:
    """Each of the two models has the flexibility that it lacks itself."""
    model, stop, drive, _ = DRIVEN["plate"]
    reduced = vi.reduce(model, [], 8)

    def motions(small: vi.models.ReducedModel, lacking: bool) -> Any:
        limiter = small.constraint(*stop, 1e-4, stiffness=1e5)
        return vi.Local().periodic_motions(
            small.system([limiter], damping=0.05, residual_flexibility=lacking),
            [30.0], [vi.drive(small.weights(*drive))], sequence="symmetric",
        )  # fmt: skip

    changes = []
    for lacking in (False, True):
        result = reduced.compute(partial(motions, lacking=lacking))
        sensitivity = result.sensitivity
        assert sensitivity is not None
        forces = [
            motions(each.model, lacking).contact.peak_force for each in (reduced, reduced.half())
        ]
        change = np.abs(forces[0] - forces[1])
        np.testing.assert_array_equal(sensitivity.change["contact.peak_force"], change)
        assert "contact.phase" not in sensitivity.change
        assert "columns of contact change by up to" in str(sensitivity)
        changes.append(sensitivity.relative("contact.duration"))
    assert changes[1] < 0.5 * changes[0]


def test_a_free_body_strikes_like_the_whole_one() -> None:
    """A free beam flies against two springs; its whole model has 42 degrees of freedom."""
    model = beam(20)
    places = [(20, "z"), (8, "z")]

    def contacts(small: vi.Model, T: np.ndarray, **options: Any) -> np.ndarray:
        stops = [
            small.constraint(*place, {"lower": None, "upper": gap}, stiffness=2e4)
            for place, gap in zip(places, (1e-3, 2e-3), strict=True)
        ]
        moving = np.array([each == "z" for _, each in model.labels], dtype=float)
        v = np.linalg.lstsq(T, moving)[0]
        np.testing.assert_allclose(T @ v, moving, atol=1e-6)
        motion = vi.Local().time_history(
            small.system(stops, **options), (0.0 * v, v), 0.02, t=[0.02], outputs=["contacts"]
        )
        assert motion.contacts.constraint.tolist()[:2] == [0, 1]
        return np.array([motion.contacts.impulse, motion.contacts.stop])[:, :2]

    whole = contacts(model, np.eye(model.n))
    reduced = vi.reduce(model, [], 6)
    modes, with_it = (
        np.abs(contacts(reduced.model, reduced.T, residual_flexibility=each) / whole - 1.0)
        for each in (False, True)
    )
    assert (with_it < 0.15 * modes).all()
    assert with_it.max() < 2e-4


def test_comparisons_with_the_whole_model_have_it() -> None:
    """Free masses in a row, of which the first is kept, lack a part of the flexibility there."""
    K = 2.0 * np.eye(20) - np.eye(20, k=1) - np.eye(20, k=-1)
    K[0, 0] = K[-1, -1] = 1.0
    reduced = vi.reduce(vi.Model(np.eye(20), K, 0.02 * K + 0.01 * np.eye(20)), [0])
    stop, compared = reduced.model.constraint(0, gap=10.0, stiffness=0.5), []
    for lacking in (False, True):
        structure = reduced.model.system(stop, residual_flexibility=lacking)
        frequencies, drive = [0.02], [vi.drive(0)]
        compared.append(
            reduced.compare(structure, frequencies, drive, at=0.05, sequence="symmetric")
        )
    without, with_it = compared
    assert with_it.flexibility_error[0, 0] < 1e-9
    assert without.flexibility_error[0, 0] > 1e-3
    np.testing.assert_array_equal(with_it.flexibility[:, 1], without.flexibility[:, 1])
    assert with_it.error[0, 0, 0] < 0.05 * without.error[0, 0, 0]
    assert with_it.motion is not None
    assert without.motion is not None
    name = "contact.duration"
    assert with_it.motion.relative(name) < 0.3 * without.motion.relative(name)
    np.testing.assert_array_equal(
        with_it.motion.whole.contact.duration, without.motion.whole.contact.duration
    )


def test_a_document_that_lost_its_place_is_refused() -> None:
    model = beam(20).fixed([0])
    small = vi.reduce(model, [(20, "z")], modes=3).model
    stop: Any = small.constraint(13, "z", 1e-3, stiffness=1e3)
    assert json.loads(json.dumps(stop)) == stop
    for same in (copy.deepcopy(stop), pickle.loads(pickle.dumps(stop))):
        assert small.residual_flexibility([same]) == small.residual_flexibility(stop)
    lost: Any = dict(stop)
    with pytest.raises(ValueError, match="constraint 1 acts on a mode"):
        small.residual_flexibility([stop, lost])
    with pytest.raises(ValueError, match="no degree of freedom 'x' of node 13"):
        small.constraint(13, "x", 1e-3)
    with pytest.raises(ValueError, match="does not have its whole model"):
        small.fixed([20]).residual_flexibility([])


@pytest.mark.parametrize(
    ("law", "message"),
    [
        ({}, "constraint 1 is rigid: in series .* a stiffness of 729397"),
        ({"stiffness": 1e3, "damping": 1.0}, "constraint 1 has a damping"),
        ({"stiffness": 1e3, "restitution": 0.5}, "constraint 1 has a damping"),
    ],
)
def test_stops_of_other_laws_are_refused(law: Any, message: str) -> None:
    small = vi.reduce(beam(20).fixed([0]), [], modes=3).model
    stops = [small.constraint(20, "z", 1e-3, stiffness=1e3)]
    stops.append(small.constraint(13, "z", 1e-3, **law))
    with pytest.raises(ValueError, match=f"residual_flexibility: {message}.* Keep its degree"):
        small.system(stops, residual_flexibility=True)
    assert "residual_flexibility" not in small.system(stops)


def test_reductions_can_be_copied_with_their_factors() -> None:
    small = vi.reduce(truss(np.random.default_rng(1)), [], modes=3).model
    stop = small.constraint(3, "x", 1e-3)
    delta = small.residual_flexibility(stop)
    other = pickle.loads(pickle.dumps(small))
    np.testing.assert_array_equal(other.residual_flexibility(stop), delta)
