"""Factors of large models: by the same structures as those of small ones, and a solid."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sparse

import vibroimpact as vi
from benchmarks.solids import solid
from tests.client.test_reductions import beam, truss
from vibroimpact.models import cholesky, dissection


@pytest.mark.parametrize("placed", [True, False])
def test_solutions_are_those_of_dense_factors(placed: bool) -> None:
    model = solid(9, 6, 4)
    K, n, rng = model.K.toarray(), model.n, np.random.default_rng(0)
    last = np.array([0, 1, 2, 24, 25, 26, n - 3, n - 2, n - 1])
    factors = cholesky.Factors(model.K, last, model.places if placed else None)
    for held in (last, last[:8], last[2:]):
        free = np.setdiff1d(np.arange(n), held)
        f = rng.normal(size=(n, 3))
        x = factors.solve(f, held)
        assert np.array_equal(x[held], np.zeros((held.size, 3)))
        expected = scipy.linalg.solve(K[np.ix_(free, free)], f[free], assume_a="pos")
        np.testing.assert_allclose(x[free], expected, rtol=0, atol=1e-9 * np.abs(expected).max())
        one = factors.solve(f[:, 0], held)
        np.testing.assert_allclose(one, x[:, 0], rtol=0, atol=1e-11 * np.abs(x).max())
    with pytest.raises(cholesky.NotDefinite):
        cholesky.Factors(model.K - 1e9 * sparse.eye_array(n), last)


def test_all_degrees_of_freedom_may_come_last() -> None:
    free = solid(9, 6, 4)
    K = free.K + 1e6 * free.M
    f = np.random.default_rng(1).normal(size=K.shape[0])
    factors = cholesky.Factors(K, np.arange(K.shape[0]))
    expected = scipy.linalg.solve(K.toarray(), f, assume_a="pos")
    np.testing.assert_allclose(factors.solve(f), expected, rtol=0, atol=1e-9 * abs(expected).max())


def test_parts_are_behind_those_they_separate() -> None:
    model = solid(9, 6, 4)
    parts = dissection.parts(model.K, model.places)
    rows = np.concatenate(parts.rows)
    assert sorted(rows) == list(range(model.n))
    place = np.argsort(rows)
    ends = np.cumsum([each.size for each in parts.rows])
    owner = np.searchsorted(ends, place, side="right")
    above = np.full(len(parts.rows), -1)
    for part, children in enumerate(parts.children):
        assert all(child < part for child in children)
        above[children] = part
    ancestors = [{part} for part in range(len(above))]
    for part in reversed(range(len(above))):
        if above[part] >= 0:
            ancestors[part] |= ancestors[above[part]]
    entries = sparse.coo_array(model.K)
    for i, j in zip(owner[entries.row], owner[entries.col], strict=True):
        assert i in ancestors[j] or j in ancestors[i]


STRUCTURES: dict[str, tuple[Callable[[], vi.Model], list[vi.models.model.Label]]] = {
    "supported solid": (
        lambda: solid(7, 5, 4).fixed(range(0, 140, 7)), [(139, "z"), (136, "y")]),
    "free solid": (lambda: solid(7, 5, 4), [(139, "z"), (136, "y")]),
    "free solid, nothing kept": (lambda: solid(7, 5, 4), []),
    "free solid, wholly held": (
        lambda: solid(7, 5, 4), [(node, each) for node in (0, 6, 139) for each in "xyz"]),
    "free beam": (lambda: beam(120), [(120, "z")]),
    "free beam without rotary mass": (lambda: beam(60, lumped=True), [(60, "z"), (30, "z")]),
    "supported beam": (lambda: beam(120).fixed([0]), [(120, "z"), (60, "z")]),
    "free truss": (lambda: truss(np.random.default_rng(1), 80), [(3, "x")]),
}  # fmt: skip


@pytest.mark.parametrize("name", STRUCTURES)
def test_reductions_by_either_factors_agree(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    make, keep = STRUCTURES[name]
    model = make()
    usual = vi.reduce(model, keep, modes=6)
    monkeypatch.setattr(cholesky, "LARGE", 1)
    large = vi.reduce(model, keep, modes=6)
    assert (large.rigid, large.kept, large.model.labels) == (
        usual.rigid, usual.kept, usual.model.labels)  # fmt: skip
    np.testing.assert_allclose(large.Omega, usual.Omega, rtol=1e-7, atol=1e-6 * usual.Omega.max())
    np.testing.assert_allclose(large.error, usual.error, rtol=1e-3, atol=1e-7)
    S = slice(0, usual.kept)
    for matrix in ("M", "K"):
        expected = getattr(usual.model, matrix).toarray()[S, S]
        found = getattr(large.model, matrix).toarray()[S, S]
        size = np.abs(expected).max(initial=1e-300)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * size)


def test_an_indefinite_stiffness_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    model = solid(5, 4, 3).fixed(range(0, 60, 5))
    softened = vi.Model(model.M, model.K - 2e9 * sparse.eye_array(model.n), labels=model.labels)
    monkeypatch.setattr(cholesky, "LARGE", 1)
    small = vi.reduce(softened, [(59, "z")], modes=3)
    assert np.isnan(small.error).all()


def test_a_slender_structure_is_factored_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its lowest modes have little energy, as rigid bodies have, but none stands apart."""
    made, usual = [], cholesky.Factors.__init__

    def counted(self: cholesky.Factors, K: Any, last: Any, places: Any = None) -> None:
        made.append(K.shape[0])
        usual(self, K, last, places)

    monkeypatch.setattr(cholesky, "LARGE", 1)
    monkeypatch.setattr(cholesky.Factors, "__init__", counted)
    clamped = beam(120).fixed([0])
    assert vi.reduce(clamped, [(120, "z")], modes=4).rigid == 0
    assert made == [clamped.n]
