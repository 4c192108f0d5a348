"""Natural frequencies of what CalculiX writes, beside its own and scipy's, and effective masses.

CalculiX prints eigenvalues with seven digits; its program is Debian's package calculix-ccx.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg

import vibroimpact as vi

pytestmark = [
    pytest.mark.needs("processes"),
    pytest.mark.skipif(shutil.which("ccx") is None, reason="Debian's calculix-ccx is not there"),
]

COUNTS = 7, 5, 3
SIZES = 0.5, 0.11, 0.06
"""Nodes of a block in x, y and z, and its size; middles of edges are among the nodes."""
MODES = 6
MASS = 7850.0 * 0.5 * 0.11 * 0.06
TETRAHEDRA = ((0, 1, 3, 7), (0, 1, 7, 5), (0, 5, 7, 4), (1, 2, 3, 7), (1, 2, 7, 6), (1, 6, 7, 5))
"""Corners of six that fill a hexahedron."""
WEDGES = ((0, 1, 2, 4, 5, 6), (0, 2, 3, 4, 6, 7))
EDGES = {
    8: ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4),
        (0, 4), (1, 5), (2, 6), (3, 7)),
    4: ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    6: ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
}  # fmt: skip
"""Corners -> the edges with a node in the middle, in the order of C3D20, C3D10 and C3D15."""
SHAPES: dict[str, tuple[int, tuple[tuple[int, ...], ...]]] = {
    "C3D8": (1, (tuple(range(8)),)),
    "C3D4": (1, TETRAHEDRA),
    "C3D6": (1, WEDGES),
    "C3D20": (2, (tuple(range(8)),)),
    "C3D10": (2, TETRAHEDRA),
}
"""Element -> its step in the grid of nodes, and the corners of those in a box."""


def _elements(step: int, parts: tuple[tuple[int, ...], ...]) -> Any:
    """Yield the places in the grid of the nodes of all elements."""
    ranges = [range(0, count, step) for count in COUNTS]
    for i, ii in pairwise(ranges[0]):
        for j, jj in pairwise(ranges[1]):
            for k, kk in pairwise(ranges[2]):
                box = [(x, y, z) for z in (k, kk) for x, y in ((i, j), (ii, j), (ii, jj), (i, jj))]
                for part in parts:
                    corners = [box[each] for each in part]
                    edges = EDGES[len(part)] if step == 2 else ()
                    middles = [np.add(corners[a], corners[b]) // 2 for a, b in edges]
                    yield [*corners, *(tuple(each.tolist()) for each in middles)]


def _deck(kind: str, step: str) -> str:
    elements = list(_elements(*SHAPES[kind]))
    used = sorted({place for each in elements for place in each})
    number = {place: row for row, place in enumerate(used, 1)}
    place = {each: np.array(each) * SIZES / (np.array(COUNTS) - 1) for each in used}
    rows = [f"{number[each]}, " + ", ".join(f"{x:.12g}" for x in place[each]) for each in used]
    lines = ["*NODE", *rows, f"*ELEMENT, TYPE={kind}, ELSET=BLOCK"]
    for row, each in enumerate(elements, 1):
        words = [str(row), *(str(number[node]) for node in each)]
        lines += [", ".join(words[:11]) + ("," if len(words) > 11 else "")]
        lines += [", ".join(words[11:])] if len(words) > 11 else []
    lines += ["*NSET, NSET=WALL", *(f"{number[each]}," for each in used if each[0] == 0)]
    lines += ["*MATERIAL, NAME=STEEL", "*ELASTIC", "2.1E11, 0.3", "*DENSITY", "7850."]
    lines += ["*SOLID SECTION, ELSET=BLOCK, MATERIAL=STEEL", "*BOUNDARY", "WALL, 1, 3"]
    return "\n".join([*lines, "*STEP", f"*FREQUENCY{step}", str(MODES), "*END STEP", ""])


def _run(folder: Path, name: str, deck: str) -> None:
    (folder / f"{name}.inp").write_text(deck)
    subprocess.run(["ccx", name], cwd=folder, check=True, stdout=subprocess.DEVNULL)


@pytest.mark.parametrize("kind", SHAPES)
def test_frequencies_are_those_of_calculix_and_scipy(kind: str, tmp_path: Path) -> None:
    _run(tmp_path, "printed", _deck(kind, ""))
    text = (tmp_path / "printed.dat").read_text()
    printed = np.array(re.findall(r"^ +\d+ +(0\.\d{7}E[+-]\d\d) ", text, re.M)[:MODES], dtype=float)
    _run(tmp_path, "block", _deck(kind, ", SOLVER=MATRIXSTORAGE"))
    block = vi.read_model(
        tmp_path / "block.sti", tmp_path / "block.mas", nodes=tmp_path / "block.inp"
    )
    eigenvalues = block.natural(MODES) ** 2
    digit = 10.0 ** (np.floor(np.log10(printed)) + 1 - 7)
    assert (np.abs(eigenvalues - printed) <= digit).all()
    M, K = block.M.toarray(), block.K.toarray()
    exact = scipy.linalg.eigh(K, M, eigvals_only=True)
    np.testing.assert_allclose(eigenvalues, exact[:MODES], rtol=1e-10)
    # Of all modes the effective masses are what moves with the base.
    along = np.array([[each == direction for _, each in block.labels] for direction in "xyz"])
    every = vi.Local().natural_frequencies(
        block.system([]), block.n, directions=along.astype(float), outputs=["effective_mass"]
    )
    moved = np.diag(along @ M @ along.T)
    np.testing.assert_allclose(every.effective_mass.sum(axis=0), moved, rtol=1e-9)
    # Nodes at the wall have the rest of the mass.
    assert (moved < MASS).all()
    assert (moved > 0.7 * MASS).all()
