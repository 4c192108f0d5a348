"""Reduced models: rigid bodies' motions, massless parts, bounds, and what the modes decide."""

from __future__ import annotations

import re
import warnings

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sparse

import vibroimpact as vi

MASS, LENGTH, EI = 0.785, 0.97, 43.75


def beam(elements: int, *, lumped: bool = False) -> vi.Model:
    """Return a free Euler-Bernoulli beam; lumped: no mass in rotations."""
    h = LENGTH / elements
    k = EI / h**3 * np.array([
        [12, 6 * h, -12, 6 * h], [6 * h, 4 * h * h, -6 * h, 2 * h * h],
        [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h * h, -6 * h, 4 * h * h],
    ])  # fmt: skip
    m = MASS / elements / 420 * np.array([
        [156, 22 * h, 54, -13 * h], [22 * h, 4 * h * h, 13 * h, -3 * h * h],
        [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h * h, -22 * h, 4 * h * h],
    ])  # fmt: skip
    if lumped:
        m = MASS / elements * np.diag([0.5, 0.0, 0.5, 0.0])
    n = 2 * elements + 2
    M, K = sparse.lil_array((n, n)), sparse.lil_array((n, n))
    for element in range(elements):
        dofs = slice(2 * element, 2 * element + 4)
        K[dofs, dofs] = K[dofs, dofs].toarray() + k
        M[dofs, dofs] = M[dofs, dofs].toarray() + m
    labels = [(node, each) for node in range(elements + 1) for each in ("z", "ry")]
    return vi.Model(M, K, labels=labels)


def test_degrees_of_freedom_to_keep_may_be_numbers() -> None:
    K = np.diag(np.full(30, 2.0)) - np.diag(np.ones(29), 1) - np.diag(np.ones(29), -1)
    model = vi.Model(np.eye(30), K)
    numbered, labelled = (
        vi.reduce(model, [7, np.int64(3)], 2),
        vi.reduce(model, [(3, "x"), (7, "x")], 2),
    )
    np.testing.assert_array_equal(numbered.model.K.toarray(), labelled.model.K.toarray())
    with pytest.raises(ValueError, match="no node 30"):
        vi.reduce(model, [30])
    # Nodes and rows of a model with nodes are not the same: a number alone is refused, and named.
    with pytest.raises(TypeError, match=r"not 4$"):
        vi.reduce(beam(8), [4, 5, 6])


def truss(rng: np.random.Generator, nodes: int = 12) -> vi.Model:
    """Return a free body: masses in space, each joined to all others by springs."""
    points = rng.normal(size=(nodes, 3))
    K = np.zeros((3 * nodes, 3 * nodes))
    for i in range(nodes):
        for j in range(i):
            along = (points[i] - points[j]) / np.linalg.norm(points[i] - points[j])
            spring = rng.uniform(1.0, 5.0) * np.outer(along, along)
            for a, b, sign in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)):
                K[3 * a : 3 * a + 3, 3 * b : 3 * b + 3] += sign * spring
    labels = [(node, each) for node in range(nodes) for each in "xyz"]
    M = np.diag(np.repeat(rng.uniform(0.5, 2.0, nodes), 3))
    return vi.Model(M, K, labels=labels, coordinates=dict(enumerate(points.tolist())))


def frequencies(model: vi.Model) -> np.ndarray:
    squares = scipy.linalg.eigh(model.K.toarray(), model.M.toarray(), eigvals_only=True)
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)))


@pytest.mark.parametrize("elements", [2, 5, 40, 300])
def test_a_free_beam_of_which_one_deflection_is_kept_is_the_rigid_bar(elements: int) -> None:
    """Masses of .785 kg were 3.07, .53, .203, .201 by mesh.

    A free bar is felt at its end as m/4: 1/m + (L/2)^2/(m L^2/12) = 4/m.
    """
    reduced = vi.reduce(beam(elements), [(elements, "z")])
    assert (reduced.model.n, reduced.kept, reduced.rigid) == (2, 1, 1)
    M, K = reduced.model.M.toarray(), reduced.model.K.toarray()
    assert 1.0 / np.linalg.inv(M)[0, 0] == pytest.approx(MASS / 4, rel=1e-6)
    assert K.tolist() == [[0.0, 0.0], [0.0, 0.0]]
    # The whole mass, and the moment of inertia, by the motions that the model can make.
    whole = beam(elements).M
    nodes = np.arange(elements + 1) * LENGTH / elements
    for z, ry in ((np.ones(elements + 1), 0.0), (nodes, 1.0)):
        motion = np.ravel(np.column_stack([z, np.full(elements + 1, ry)]))
        q = np.linalg.lstsq(reduced.T, motion)[0]
        assert np.abs(reduced.expand(q) - motion).max() < 1e-5 * np.abs(motion).max()
        assert q @ M @ q == pytest.approx(motion @ (whole @ motion), rel=1e-6)


@pytest.mark.parametrize("elements", [4, 60])
@pytest.mark.parametrize("keep", [[], ["end"], ["end", "other"], ["middle"], ["end", "turn"]])
@pytest.mark.parametrize("modes", [0, 1, 4])
def test_free_beams_keep_the_rigid_motions_and_their_frequencies(
    elements: int, keep: list[str], modes: int
) -> None:
    model = beam(elements)
    places = {"end": (0, "z"), "other": (elements, "z"), "middle": (elements // 2, "z"),
              "turn": (elements, "ry")}  # fmt: skip
    reduced = vi.reduce(model, [places[each] for each in keep], modes, compare=2 + modes)
    assert reduced.model.n == len(keep) + reduced.rigid + modes
    assert len(keep) + reduced.rigid >= 2
    small = frequencies(reduced.model)
    assert np.all(small[:2] < 1e-3 * frequencies(model)[2])
    assert reduced.Omega[:2].tolist() == reduced.error[:2].tolist() == [0.0, 0.0]
    np.testing.assert_allclose(reduced.Omega, small[: len(reduced.Omega)], rtol=1e-9, atol=1e-3)
    true = frequencies(model)[2:]
    for Omega, error in zip(reduced.Omega[2:], reduced.error[2:], strict=True):
        assert np.abs(Omega / true - 1.0).min() <= error + 1e-9
    assert not np.isnan(reduced.error).any()


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("count", [0, 1, 3, 5, 6, 9])
def test_free_bodies_in_space(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    model = truss(rng)
    keep = [model.labels[row] for row in rng.choice(model.n, count, replace=False)]
    reduced = vi.reduce(model, keep, modes=5, compare=11)
    assert reduced.kept == count
    assert reduced.rigid >= 6 - count
    assert (reduced.Omega == 0.0).sum() == 6
    assert np.count_nonzero(frequencies(reduced.model) < 1e-6) == 6
    true = frequencies(model)[6:]
    for Omega, error in zip(reduced.Omega[6:], reduced.error[6:], strict=True):
        assert np.abs(Omega / true - 1.0).min() <= error + 1e-12
    # Turned and moved as a whole, the reduced model has the same energy of motion.
    points = np.array([model.coordinates[node] for node in range(12)])
    motion = np.ravel(np.cross(rng.normal(size=3), points) + rng.normal(size=3))
    q = np.linalg.lstsq(reduced.T, motion)[0]
    np.testing.assert_allclose(reduced.expand(q), motion, atol=1e-9)
    assert q @ (reduced.model.M @ q) == pytest.approx(motion @ (model.M @ motion), rel=1e-9)


@pytest.mark.parametrize(("spring", "rigid"), [(100.0, None), (1.0, 0), (1e-2, 0)])
def test_a_soft_suspension_is_none_of_a_rigid_body(spring: float, rigid: int | None) -> None:
    model = beam(20)
    K = model.K.tolil()
    for row in (0, 40):
        K[row, row] += spring
    soft = vi.Model(model.M, K, labels=model.labels)
    reduced = vi.reduce(soft, [(20, "z")], 3, compare=2, rigid=rigid)
    assert reduced.rigid == 0
    # Against the natural frequencies of the rigid bar on its springs: sqrt(2 k/m), sqrt(6 k/m).
    bar = np.sqrt(np.array([2.0, 6.0]) * spring / MASS)
    np.testing.assert_allclose(reduced.Omega, bar, rtol=0.02 if spring > 1.0 else 1e-3)


@pytest.mark.parametrize("digits", [6, 9])
def test_a_rounded_stiffness_is_warned_of_and_has_a_way_out(digits: int) -> None:
    """Files with few digits: rigid-body modes have some elastic energy, of either sign."""
    model = beam(20)
    K = model.K.copy()
    K.data = np.array([float(f"{value:.{digits}e}") for value in K.data])
    K = 0.5 * (K + K.T)
    rounded = vi.Model(model.M, K, labels=model.labels)
    with pytest.warns(UserWarning, match=r"K nearly has 2 rigid-body modes .* rigid=2; .* rigid=0"):
        vi.reduce(rounded, [(20, "z"), (0, "z")])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        reduced = vi.reduce(rounded, [(20, "z")], modes=3, compare=4, rigid=2)
    exact = vi.reduce(model, [(20, "z")], modes=3, compare=4)
    assert reduced.rigid == 1
    rtol = {6: 2e-3, 9: 1e-5}[digits]  # the roundings over the lowest frequency
    np.testing.assert_allclose(reduced.Omega, exact.Omega, rtol=rtol)


def test_masses_and_springs_that_are_not_there_are_named() -> None:
    K = np.array([[1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    model = vi.Model(np.diag([1.0, 1.0, 0.0]), K, labels=[(1, "x"), (2, "x"), (9, "rx")])
    for call in (lambda: vi.reduce(model, [(1, "x")]), lambda: vi.condense(model),
                 lambda: vi.reduce(model, [(9, "rx")], 1)):  # fmt: skip
        with pytest.raises(
            ValueError, match="node 9 rx can move without mass and without stiffness"
        ):
            call()


@pytest.mark.parametrize("keep", [[(12, "z")], [(12, "ry")], [(12, "z"), (12, "ry")], []])
@pytest.mark.parametrize("free", [False, True])
def test_rotations_without_mass_are_reduced(keep: list[tuple[int, str]], free: bool) -> None:
    """They ended in scipy's LinAlgError."""
    model = beam(12, lumped=True)
    model = model if free else model.fixed([0])
    reduced = vi.reduce(model, keep, modes=4, compare=5)
    condensed = vi.condense(model)
    true = frequencies(condensed.model)
    first = 2 * free
    assert len(reduced.Omega) > first
    for Omega, error in zip(reduced.Omega[first:], reduced.error[first:], strict=True):
        assert np.abs(Omega / true[first:] - 1.0).min() <= error + 1e-9
    with pytest.raises(ValueError, match=r"modes are more than the 1\d that have mass"):
        vi.reduce(model, [(12, "z")], modes=20)


def test_no_bound_is_promised_where_none_holds() -> None:
    """K with a negative eigenvalue, as of a buckled structure."""
    K = np.array([[1.0, -1.0, 0.0, 0.0], [-1.0, 3.0, -1.0, 0.0], [0.0, -1.0, 1.2, -1.0],
                  [0.0, 0.0, -1.0, 1.4]])  # fmt: skip
    assert scipy.linalg.eigvalsh(K)[0] < 0.0
    reduced = vi.reduce(vi.Model(np.eye(4), K), [(0, "x")], modes=2, compare=3)
    assert np.isnan(reduced.error).tolist() == [True] * 3
    held = K + 0.5 * np.eye(4)
    assert scipy.linalg.eigvalsh(held)[0] > 0.0
    assert np.isfinite(vi.reduce(vi.Model(np.eye(4), held), [(0, "x")], modes=2).error).all()


def test_parts_that_are_not_held_are_refused() -> None:
    """K is indefinite: held at one point, forces at it have no answer."""
    K = np.array([[1.0, -1.0, 0.0], [-1.0, 1.0, -1.0], [0.0, -1.0, 1.0]])
    with pytest.raises(ValueError, match="not held by springs"):
        vi.reduce(vi.Model(np.eye(3), K), [(0, "x")])


def test_half_of_the_modes_are_left_out() -> None:
    model = beam(30)
    reduced = vi.reduce(model, [(30, "z")], modes=7)
    half, few = reduced.half(), vi.reduce(model, [(30, "z")], modes=3)
    assert (half.modes, half.rigid, half.kept, half.model.labels) == (3, 1, 1, few.model.labels)
    for name in ("M", "K"):
        ours, theirs = (getattr(each.model, name).toarray() for each in (half, few))
        np.testing.assert_allclose(np.abs(ours), np.abs(theirs), atol=1e-9 * np.abs(theirs).max())
    np.testing.assert_allclose(np.abs(half.T), np.abs(few.T), atol=1e-7)


@pytest.mark.parametrize("keep", [[(12, "z")], [(12, "z"), (6, "ry")], [(12, "ry")]])
@pytest.mark.parametrize("lumped", [False, True])
def test_a_base_moves_the_modes_too(keep: list[tuple[int, str]], lumped: bool) -> None:
    """The base moved the kept degrees of freedom alone, with their share of the mass."""
    model = beam(12, lumped=lumped).fixed([0])
    reduced = vi.reduce(model, keep, modes=6)
    small, r = reduced.model, model.influence("z")
    for each in (reduced, reduced.half()):
        forces = each.T.T @ (model.M @ r)
        found = each.model.M @ each.model.influence("z")
        np.testing.assert_allclose(found, forces, rtol=0, atol=1e-12 * np.abs(forces).max())
    # Displacements of the whole beam whose base vibrates below its first natural frequency.
    turning = 0.5 * frequencies(vi.condense(model).model)[0]
    Z, z = (part.K.toarray() - turning**2 * part.M.toarray() for part in (model, small))
    whole = np.linalg.solve(Z, model.M @ r)
    mine = reduced.expand(np.linalg.solve(z, small.M @ small.influence("z")))
    assert np.abs(mine - whole).max() < 2e-4 * np.abs(whole).max()
    assert small.part([0]).influence("z").shape == (1,)
    with pytest.raises(ValueError, match="direction 'mode': there are z, ry"):
        small.influence("mode")


@pytest.mark.needs("processes")
def test_results_say_what_changes_with_half_of_the_modes() -> None:
    """Against the same computation with the smaller model, and one worked out by hand."""
    model = beam(12).fixed([0])
    reduced = vi.reduce(model, [(12, "z")], modes=4)
    first = frequencies(model)[0]
    local = vi.Local()

    def blows(small: vi.Model) -> vi.Result:
        structure = small.system([small.constraint(12, "z", 1e-3)])
        outputs = ["impulse", "exists", "shape"]
        return local.impact_modes(structure, [1.5 * first, 2.5 * first], outputs=outputs)

    result = reduced.compute(blows)
    sensitivity = result.sensitivity
    assert sensitivity is not None
    assert (sensitivity.modes, sensitivity.half_modes) == (4, 2)
    # An impulse by the natural modes: gap = p sum of phi^2 tan(gamma)/(gamma) / omega^2.
    by_hand = []
    for count in (4, 2):
        small = vi.reduce(model, [(12, "z")], modes=count).model
        squares, Phi = scipy.linalg.eigh(small.K.toarray(), small.M.toarray())
        omega = 2.0 / np.pi * np.array([1.5, 2.5]) * first
        gamma = np.sqrt(squares)[:, np.newaxis] / omega
        by_hand.append(
            1e-3 * omega**2 / np.sum(Phi[0][:, np.newaxis] ** 2 * np.tan(gamma) / gamma, 0)
        )
    change = np.abs(by_hand[0] - by_hand[1])
    np.testing.assert_allclose(sensitivity.change["impulse"][:, 0], change, rtol=1e-6)
    assert sensitivity.relative("impulse") == pytest.approx(change.max() / np.abs(by_hand[0]).max())
    # Of displacements, those that both have: the kept one, which is at its stop.
    assert sensitivity.change["shape"].shape == (2, 1)
    assert np.all(sensitivity.change["shape"] < 1e-15)
    assert re.search(r"with 2 of 4 modes, .*impulse changes by up to [\d.e+]+ %", repr(result))
    assert "with 2 of 4 modes" in result._repr_html_()
    assert sensitivity.change.keys() == {"impulse", "momentum", "exists", "shape", "witness"}
    assert blows(reduced.model).sensitivity is None
    with pytest.raises(ValueError, match="has none to leave out"):
        vi.reduce(model, [(12, "z")]).compute(blows)
