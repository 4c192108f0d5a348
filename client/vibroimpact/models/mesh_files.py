"""Motions on the mesh as files of ParaView: VTU with PVD for the times, or XDMF with HDF5.

The layouts: Kitware, VTK File Formats (XML, unstructured grid; numbers as base64 behind their
count of bytes); XDMF Model and Format, version 3.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree

import h5py
import numpy as np

from vibroimpact.tables import Array

CELLS: Final[Mapping[str, tuple[int, int, int]]] = {
    "vertex": (1, 1, 1), "line": (3, 2, 2), "triangle": (5, 3, 4), "quad": (9, 4, 5),
    "tetra": (10, 4, 6), "pyramid": (14, 5, 7), "wedge": (13, 6, 8), "hexahedron": (12, 8, 9),
    "triangle6": (22, 6, 36), "quad8": (23, 8, 37), "tetra10": (24, 10, 38),
    "wedge15": (26, 15, 40), "hexahedron20": (25, 20, 48),
}  # fmt: skip
"""Shape of an element -> its number in VTK, its nodes, and its number in XDMF."""
_TYPES: Final = {"f8": "Float64", "i8": "Int64", "u1": "UInt8"}


@dataclass(frozen=True, eq=False)
class Mesh:
    """Nodes and elements.

    Parameters
    ----------
    nodes : sequence of int
        Their labels.
    places : array, shape (node, 3)
        Where they are at rest.
    elements : mapping
        Shape, of `CELLS` -> nodes of each element by their position in `nodes`.
    """

    nodes: Sequence[int]
    places: Array
    elements: Mapping[str, Any]


def mesh(
    coordinates: Mapping[int, Sequence[float]], elements: Mapping[str, Sequence[Sequence[int]]]
) -> Mesh:
    """Return the mesh of nodes and of elements, which name their nodes; without any, of points.

    Raises
    ------
    ValueError
        If there are no nodes, or elements have a shape or nodes that do not exist.
    """
    if not coordinates:
        raise ValueError("the model has no coordinates: give them by nodes= or coordinates=")
    nodes = list(coordinates)
    places = np.zeros((len(nodes), 3))
    for row, node in enumerate(nodes):
        places[row, : len(coordinates[node])] = coordinates[node]
    position = {node: row for row, node in enumerate(nodes)}
    cells: dict[str, Any] = {}
    for shape, given in elements.items():
        if shape not in CELLS:
            raise ValueError(f"{shape!r} is none of {', '.join(CELLS)}")
        unknown = {node for each in given for node in each} - position.keys()
        if unknown or any(len(each) != CELLS[shape][1] for each in given):
            lack = f"nodes {sorted(unknown)[:5]} are unknown" if unknown else (
                f"they need {CELLS[shape][1]} nodes")  # fmt: skip
            raise ValueError(f"elements {shape}: {lack}")
        cells[shape] = np.array([[position[node] for node in each] for each in given])
    if not cells:
        cells["vertex"] = np.arange(len(nodes))[:, np.newaxis]
    return Mesh(nodes, places, cells)


def write_vtu(path: Path, grid: Mesh, fields: Mapping[str, Array]) -> None:
    """Write displacements and more, each shape (node, component), at one time."""
    root = ElementTree.Element("VTKFile", type="UnstructuredGrid", version="1.0",
                               byte_order="LittleEndian", header_type="UInt64")  # fmt: skip
    inner = ElementTree.SubElement(root, "UnstructuredGrid")
    count = sum(len(each) for each in grid.elements.values())
    piece = ElementTree.SubElement(inner, "Piece", NumberOfPoints=str(len(grid.nodes)),
                                   NumberOfCells=str(count))  # fmt: skip
    data = ElementTree.SubElement(piece, "PointData")
    _numbers(data, "node", np.array(grid.nodes, dtype="<i8"))
    for name, values in fields.items():
        _numbers(data, name, np.asarray(values, dtype="<f8"))
    _numbers(ElementTree.SubElement(piece, "Points"), "Points", grid.places.astype("<f8"))
    cells = ElementTree.SubElement(piece, "Cells")
    each = grid.elements.items()
    sizes = [np.full(len(ends), CELLS[shape][1]) for shape, ends in each]
    kinds = [np.full(len(ends), CELLS[shape][0]) for shape, ends in each]
    connected = np.concatenate([ends.ravel() for _, ends in each]).astype("<i8")
    _numbers(cells, "connectivity", connected)
    _numbers(cells, "offsets", np.cumsum(np.concatenate(sizes)).astype("<i8"))
    _numbers(cells, "types", np.concatenate(kinds).astype("u1"))
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def _numbers(parent: ElementTree.Element, name: str, values: Array) -> None:
    components = values.shape[1] if values.ndim == 2 else 1
    array = ElementTree.SubElement(parent, "DataArray", type=_TYPES[values.dtype.str[1:]],
                                   Name=name, NumberOfComponents=str(components),
                                   format="binary")  # fmt: skip
    body = np.ascontiguousarray(values).tobytes()
    array.text = base64.b64encode(len(body).to_bytes(8, "little") + body).decode("ascii")


def write_pvd(path: Path, grid: Mesh, t: Array, fields: Mapping[str, Array]) -> None:
    """Write a file for each time into a folder beside, and one that lists them.

    Parameters
    ----------
    path : Path
        Ends in ``.pvd``; the folder has its name.
    grid : Mesh
    t : array, shape (time,)
    fields : mapping
        Name -> values, shape (time, node, component).
    """
    folder = path.with_suffix("")
    folder.mkdir(parents=True, exist_ok=True)
    root = ElementTree.Element("VTKFile", type="Collection", version="0.1")
    series = ElementTree.SubElement(root, "Collection")
    digits = len(str(len(t) - 1))
    for row, time in enumerate(t):
        name = f"{row:0{digits}}.vtu"
        write_vtu(folder / name, grid, {key: each[row] for key, each in fields.items()})
        ElementTree.SubElement(series, "DataSet", timestep=repr(float(time)), part="0",
                               file=f"{folder.name}/{name}")  # fmt: skip
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def write_xdmf(path: Path, grid: Mesh, t: Array, fields: Mapping[str, Array]) -> None:
    """Write a file of text, ``.xdmf``, and the numbers in HDF5 beside it; as `write_pvd`."""
    store = path.with_suffix(".h5")
    mixed = np.concatenate([
        np.concatenate([np.full((len(ends), 1), CELLS[shape][2]), *_count(shape, ends), ends],
                       axis=1).ravel()
        for shape, ends in grid.elements.items()
    ])  # fmt: skip
    count = sum(len(each) for each in grid.elements.values())
    root = ElementTree.Element("Xdmf", Version="3.0")
    domain = ElementTree.SubElement(root, "Domain")
    series = ElementTree.SubElement(domain, "Grid", Name="motion", GridType="Collection",
                                    CollectionType="Temporal")  # fmt: skip
    with h5py.File(store, "w") as file:
        file["places"], file["cells"] = grid.places, mixed
        for name, values in fields.items():
            file.create_dataset(name, data=values, compression="gzip", shuffle=True,
                                chunks=(1, *values.shape[1:]))  # fmt: skip
    for row, time in enumerate(t):
        frame = ElementTree.SubElement(series, "Grid", Name=f"{row}", GridType="Uniform")
        ElementTree.SubElement(frame, "Time", Value=repr(float(time)))
        topology = ElementTree.SubElement(frame, "Topology", TopologyType="Mixed",
                                          NumberOfElements=str(count))  # fmt: skip
        _stored(topology, store, "cells", mixed.shape, "Int")
        geometry = ElementTree.SubElement(frame, "Geometry", GeometryType="XYZ")
        _stored(geometry, store, "places", grid.places.shape, "Float")
        for name, values in fields.items():
            attribute = ElementTree.SubElement(frame, "Attribute", Name=name, Center="Node",
                                               AttributeType="Vector")  # fmt: skip
            _slab(attribute, store, name, row, values.shape)
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def _count(shape: str, ends: Any) -> list[Any]:
    """Return the column of numbers of nodes, which points and lines need."""
    return [np.full((len(ends), 1), CELLS[shape][1])] if shape in ("vertex", "line") else []


def _stored(
    parent: ElementTree.Element, store: Path, name: str, shape: Sequence[int], kind: str
) -> None:
    item = ElementTree.SubElement(parent, "DataItem", Dimensions=_words(shape), NumberType=kind,
                                  Precision="8", Format="HDF")  # fmt: skip
    item.text = f"{store.name}:/{name}"


def _slab(
    parent: ElementTree.Element, store: Path, name: str, row: int, shape: Sequence[int]
) -> None:
    """Add one time of an array of all times."""
    part = ElementTree.SubElement(parent, "DataItem", ItemType="HyperSlab", Type="HyperSlab",
                                  Dimensions=_words(shape[1:]))  # fmt: skip
    which = ElementTree.SubElement(part, "DataItem", Dimensions="3 3", Format="XML")
    which.text = f"{row} 0 0 1 1 1 1 {_words(shape[1:])}"
    _stored(part, store, name, shape, "Float")


def _words(shape: Sequence[int]) -> str:
    return " ".join(map(str, shape))
