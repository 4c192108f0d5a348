"""Motions of a model as files of ParaView and of programs of modal tests."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np

from vibroimpact.models import mesh_files, universal_files
from vibroimpact.tables import Array
from vibroimpact_schema.files.labels import DIRECTIONS

_WORDS: Final = {"displacement": "rotation", "velocity": "angular_velocity"}
"""Vectors of displacements -> those of rotations."""
_ENDINGS: Final = (".vtu", ".pvd", ".xdmf", ".unv", ".uff")


class _Model(Protocol):
    """What is needed of a model."""

    @property
    def n(self) -> int: ...
    @property
    def labels(self) -> Sequence[tuple[int, str]]: ...
    @property
    def coordinates(self) -> Mapping[int, Sequence[float]]: ...
    @property
    def elements(self) -> Mapping[str, Sequence[Sequence[int]]]: ...
    @property
    def units(self) -> Mapping[str, str] | None: ...


def write_motion(model: _Model, path: Path, x: Array, t: Array | None, v: Array | None) -> None:
    """Write a motion, in the format that the ending of the file says; as of `Model.write`."""
    ending = path.suffix.lower()
    if ending not in _ENDINGS:
        raise ValueError(f"{path}: known are files ending in {', '.join(_ENDINGS)}")
    motions = {"displacement": _checked(model, "x", x)}
    if v is not None:
        motions["velocity"] = _checked(model, "v", v)
    count = len(motions["displacement"])
    times = np.arange(float(count)) if t is None else np.asarray(t, dtype=np.float64)
    if times.shape != (count,) or any(len(each) != count for each in motions.values()):
        raise ValueError(f"t and v need {count} times, as many as x")
    if not np.isfinite(times).all():
        raise ValueError("t has entries that are not finite")
    if ending in (".unv", ".uff"):
        ends = [(node, DIRECTIONS.index(each) + 1) for node, each in model.labels
                if each in DIRECTIONS]  # fmt: skip
        kept = [row for row, (_, each) in enumerate(model.labels) if each in DIRECTIONS]
        functions = {name: each[:, kept] for name, each in motions.items()}
        universal_files.write(path, times, functions, ends, model.coordinates, model.units)
        return
    grid = mesh_files.mesh(model.coordinates, model.elements)
    fields = _fields(model, grid.nodes, motions)
    if ending == ".vtu":
        if count != 1:
            raise ValueError(f"{path}: one shape is a .vtu, {count} times are a .pvd or .xdmf")
        mesh_files.write_vtu(path, grid, {name: each[0] for name, each in fields.items()})
    elif ending == ".pvd":
        mesh_files.write_pvd(path, grid, times, fields)
    else:
        mesh_files.write_xdmf(path, grid, times, fields)


def _checked(model: _Model, name: str, values: Array) -> Array:
    """Return values of each time and degree of freedom."""
    rows = np.atleast_2d(np.asarray(values, dtype=np.float64))
    if rows.ndim != 2 or rows.shape[1] != model.n:
        raise ValueError(f"{name} has the shape {rows.shape}; expected (time, {model.n})")
    if not np.isfinite(rows).all():
        raise ValueError(f"{name} has entries that are not finite")
    return rows


def _fields(model: _Model, nodes: Sequence[int], motions: Mapping[str, Array]) -> dict[str, Array]:
    """Return displacements, rotations and more as vectors of nodes, shape (time, node, 3)."""
    position = {node: row for row, node in enumerate(nodes)}
    missing = {node for node, each in model.labels if each in DIRECTIONS} - position.keys()
    # A mesh has all nodes of its elements; others are a program's own, as of incompatible modes.
    if missing and not model.elements:
        raise ValueError(f"nodes {', '.join(map(str, sorted(missing)[:10]))} have no coordinates")
    fields: dict[str, Any] = {}
    for name, values in motions.items():
        for part, word in ((DIRECTIONS[:3], name), (DIRECTIONS[3:], _WORDS[name])):
            used = [
                (column, position[node], part.index(each))
                for column, (node, each) in enumerate(model.labels)
                if each in part and node in position
            ]
            if not used and word != name:
                continue
            vectors = np.zeros((len(values), len(nodes), 3))
            for column, row, component in used:
                vectors[:, row, component] = values[:, column]
            fields[word] = vectors
    return fields
