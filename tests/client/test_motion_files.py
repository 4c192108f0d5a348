"""Motions on the mesh: files of ParaView and universal files, read by their layouts."""

from __future__ import annotations

import base64
import itertools
from pathlib import Path
from xml.etree import ElementTree

import h5py
import numpy as np
import pytest

import vibroimpact as vi

COORDINATES = {7: [0.0, 0.0, 0.0], 9: [1.0, 0.0, 0.0], 12: [1.0, 1.0, 0.5], 4: [0.0, 1.0, 0.0]}
LABELS = [(7, "x"), (7, "z"), (9, "y"), (12, "x"), (12, "rz"), (4, "z")]
T = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
X = np.random.default_rng(5).normal(size=(5, 6))


def _model(**options: object) -> vi.Model:
    given: dict[str, object] = {
        "labels": LABELS, "coordinates": COORDINATES, "elements": {"quad": [[7, 9, 12, 4]]},
        "units": {"length": "mm", "mass": "t", "time": "s"},
    } | options  # fmt: skip
    return vi.Model(np.eye(6), 2.0 * np.eye(6), **given)  # type: ignore[arg-type]


def _vectors(x: np.ndarray) -> np.ndarray:
    """Return displacements of the nodes in the order of the coordinates, shape (4, 3)."""
    return np.array([[x[0], 0, x[1]], [0, x[2], 0], [x[3], 0, 0], [0, 0, x[5]]])


def _vtu(path: Path) -> dict[str, np.ndarray]:
    found = {}
    for each in ElementTree.parse(path).iter("DataArray"):
        data = base64.b64decode(each.text or "")
        size = int.from_bytes(data[:8], "little")
        assert size == len(data) - 8
        kind = {"Float64": "<f8", "Int64": "<i8", "UInt8": "u1"}[each.attrib["type"]]
        values = np.frombuffer(data[8:], kind)
        components = int(each.attrib["NumberOfComponents"])
        found[each.attrib["Name"]] = values.reshape(-1, components) if components > 1 else values
    return found


def test_a_shape_for_paraview(tmp_path: Path) -> None:
    _model().write(tmp_path / "shape.vtu", X[0])
    found = _vtu(tmp_path / "shape.vtu")
    assert found["node"].tolist() == [7, 9, 12, 4]
    assert found["Points"].tolist() == list(COORDINATES.values())
    assert found["displacement"].tolist() == _vectors(X[0]).tolist()
    assert found["rotation"].tolist() == [[0, 0, 0], [0, 0, 0], [0, 0, X[0, 4]], [0, 0, 0]]
    assert found["connectivity"].tolist() == [0, 1, 2, 3]
    assert (found["offsets"].tolist(), found["types"].tolist()) == ([4], [9])
    _model(elements={}).write(tmp_path / "points.vtu", X[0])
    assert _vtu(tmp_path / "points.vtu")["types"].tolist() == [1] * 4


def test_a_series_for_paraview(tmp_path: Path) -> None:
    _model().write(tmp_path / "film.pvd", X, T, v=2.0 * X)
    sets = list(ElementTree.parse(tmp_path / "film.pvd").iter("DataSet"))
    assert [float(each.attrib["timestep"]) for each in sets] == T.tolist()
    for row, each in enumerate(sets):
        found = _vtu(tmp_path / each.attrib["file"])
        assert found["displacement"].tolist() == _vectors(X[row]).tolist()
        assert found["velocity"].tolist() == _vectors(2.0 * X[row]).tolist()


def test_a_series_as_xdmf(tmp_path: Path) -> None:
    _model().write(tmp_path / "film.xdmf", X, T)
    root = ElementTree.parse(tmp_path / "film.xdmf")
    assert [float(each.attrib["Value"]) for each in root.iter("Time")] == T.tolist()
    slab = [each for each in root.iter("DataItem") if each.attrib.get("ItemType") == "HyperSlab"]
    start = (slab[2 * 3][0].text or "").split()  # displacements and rotations of each time
    assert start == ["3", "0", "0", "1", "1", "1", "1", "4", "3"]
    with h5py.File(tmp_path / "film.h5") as file:
        assert file["displacement"][3].tolist() == _vectors(X[3]).tolist()
        assert file["cells"][()].tolist() == [5, 0, 1, 2, 3]
        assert file["places"][()].tolist() == list(COORDINATES.values())


@pytest.mark.parametrize("even", [True, False])
def test_universal_files(tmp_path: Path, even: bool) -> None:
    times = T if even else T**2
    _model().write(tmp_path / "test.unv", X, times, v=3.0 * X)
    sets = (tmp_path / "test.unv").read_text().split(f"{-1:6}\n")[1::2]
    assert all(len(line) <= 80 for text in sets for line in text.splitlines())
    assert [int(text.split()[0]) for text in sets] == [15] + [58] * 12
    nodes = [line.split() for line in sets[0].splitlines()[1:]]
    assert [int(row[0]) for row in nodes] == [7, 9, 12, 4]
    assert [[float(v) for v in row[4:]] for row in nodes] == list(COORDINATES.values())
    for number, text in enumerate(sets[1:]):
        lines = text.splitlines()
        column, factor = number % 6, (1.0, 3.0)[number // 6]
        node, direction = LABELS[column]
        assert int(lines[6][41:51]) == node
        assert int(lines[6][51:55]) == ("x", "y", "z", "rx", "ry", "rz").index(direction) + 1
        assert [int(lines[7][k : k + 10]) for k in (0, 10, 20)] == [4, 5, int(even)]
        assert int(lines[9][:10]) == (8, 11)[number // 6]
        widths = [20] * 4 if even else [13, 20, 13, 20]
        values = []
        for line in lines[12:]:
            ends = np.cumsum([0, *widths])
            values += [float(line[a:b]) for a, b in itertools.pairwise(ends)
                       if line[a:b].strip()]  # fmt: skip
        found = values if even else values[1::2]
        np.testing.assert_allclose(found, factor * X[:, column], rtol=1e-12)
        if even:
            assert float(lines[7][43:56]) == 0.25
        else:
            np.testing.assert_allclose(values[::2], times, rtol=1e-5)


@pytest.mark.parametrize(
    ("name", "change", "reason"),
    [("a.txt", {}, "known are files ending in .vtu"), ("a.vtu", {}, "5 times are a .pvd"),
     ("a.pvd", {"x": X[:, :5]}, r"x has the shape \(5, 5\); expected \(time, 6\)"),
     ("a.pvd", {"x": X * np.nan}, "x has entries that are not finite"),
     ("a.pvd", {"t": T[:4]}, "need 5 times"), ("a.pvd", {"v": X[:4]}, "need 5 times"),
     ("a.unv", {"t": T + np.inf}, "t has entries that are not finite")],
)  # fmt: skip
def test_what_cannot_be_written(
    tmp_path: Path, name: str, change: dict[str, np.ndarray], reason: str
) -> None:
    given = {"x": X, "t": T} | change
    with pytest.raises(ValueError, match=reason):
        _model().write(tmp_path / name, **given)  # type: ignore[arg-type]
    assert list(tmp_path.iterdir()) == []


def test_unknown_nodes_are_not_left_out(tmp_path: Path) -> None:
    few = {node: COORDINATES[node] for node in (7, 9, 12)}
    with pytest.raises(ValueError, match="nodes 4 have no coordinates"):
        _model(coordinates=few, elements={}).write(tmp_path / "a.pvd", X)
    with pytest.raises(ValueError, match=r"elements quad: nodes \[5\] are unknown"):
        _model(elements={"quad": [[7, 9, 12, 5]]}).write(tmp_path / "a.pvd", X)
    with pytest.raises(ValueError, match="elements quad: they need 4 nodes"):
        _model(elements={"quad": [[7, 9, 12]]}).write(tmp_path / "a.pvd", X)
    with pytest.raises(ValueError, match="the model has no coordinates"):
        _model(coordinates={}, elements={}).write(tmp_path / "a.pvd", X)


def test_nodes_that_no_mesh_has_are_left_out(tmp_path: Path) -> None:
    """A program's own, as those of CalculiX's incompatible modes."""
    few = {node: COORDINATES[node] for node in (7, 9, 12)}
    mesh = {"triangle": [[7, 9, 12]]}
    _model(coordinates=few, elements=mesh).write(tmp_path / "a.vtu", X[0])
    _model(elements=mesh).write(tmp_path / "b.vtu", X[0])
    points = 'NumberOfPoints="'
    counts = [
        int((tmp_path / name).read_bytes().split(points.encode())[1].split(b'"')[0])
        for name in ("a.vtu", "b.vtu")
    ]
    assert counts == [3, len(COORDINATES)]


def test_elements_of_decks(tmp_path: Path) -> None:
    deck = tmp_path / "a.inp"
    nodes = "".join(f"{k}, {k}., 0., 0.\n" for k in range(1, 21))
    deck.write_text(
        f"*NODE\n{nodes}*ELEMENT, TYPE=C3D20R\n1, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14,\n"
        "15, 16, 17, 18, 19, 20\n*ELEMENT, TYPE=S4R\n2, 1, 2, 3, 4\n*ELEMENT, TYPE=MASS\n3, 1\n"
    )
    elements = vi.read_nodes(deck).elements
    assert elements == {"hexahedron20": [list(range(1, 21))], "quad": [[1, 2, 3, 4]]}
    deck = tmp_path / "a.bdf"
    deck.write_text(
        "".join(f"GRID,{k},,{k}.,0.,0.\n" for k in range(1, 9))
        + "CHEXA,1,1,1,2,3,4,5,6\n,7,8\nCBAR,2,1,1,2,0.,0.,1.\nCTRIA3  3       1       1       2"
        "       3\n"
    )
    elements = vi.read_nodes(deck).elements
    assert elements == {"hexahedron": [[1, 2, 3, 4, 5, 6, 7, 8]], "line": [[1, 2]],
                        "triangle": [[1, 2, 3]]}  # fmt: skip
