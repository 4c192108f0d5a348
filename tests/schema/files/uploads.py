"""A small model in the files of every format that client and service read alike."""

from __future__ import annotations

import gzip
import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import scipy.sparse as sparse

from tests.client import model_files as files
from tests.client import program_files as programs

MODEL = files.model(np.random.default_rng(3))
NASTRAN = {"MGG": MODEL["M"], "KGG": MODEL["K"], "BGG": MODEL["C"]}

Contents = Mapping[str, bytes]
"""Name of a file -> its content."""


def _npy(array: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array)
    return buffer.getvalue()


def _npz(arrays: Mapping[str, np.ndarray]) -> bytes:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)  # type: ignore[arg-type]
    return buffer.getvalue()


def _sparse_npz(matrix: np.ndarray, form: str) -> bytes:
    buffer = io.BytesIO()
    sparse.save_npz(buffer, getattr(sparse, f"{form}_array")(matrix))
    return buffer.getvalue()


def _each(write: object, ending: str) -> Contents:
    """Return a file for each matrix, M.ending and so on."""
    given = {name: write(matrix) for name, matrix in MODEL.items()}  # type: ignore[operator]
    return {
        f"{name}{ending}": text.encode() if isinstance(text, str) else text
        for name, text in given.items()
    }


FORMATS: dict[str, Contents] = {
    "market": _each(files.market, ".mtx"),
    "market array": _each(lambda m: files.market(m, form="array"), ".mtx"),
    "market packed": {
        f"{name}.gz": gzip.compress(text) for name, text in _each(files.market, ".mtx").items()
    },
    "market in one": {"all.mtx": "".join(files.market(MODEL[name]) for name in "MKC").encode()},
    "entries": _each(files.coordinates, ".mtx"),
    "abaqus": _each(lambda m: programs.abaqus(m, "MATRIX INPUT"), ".mtx"),
    "npy": _each(_npy, ".npy"),
    "npy in one": {"all.npy": _npy(np.array([MODEL[name] for name in "MKC"]))},
    "npz": {"all.npz": _npz(MODEL)},
    "csr": _each(lambda m: _sparse_npz(m, "csr"), ".npz"),
    "csc": _each(lambda m: _sparse_npz(m, "csc"), ".npz"),
    "coo": _each(lambda m: _sparse_npz(m, "coo"), ".npz"),
    "bsr": _each(lambda m: _sparse_npz(m, "bsr"), ".npz"),
    "dia": _each(lambda m: _sparse_npz(m, "dia"), ".npz"),
    "csv": _each(files.rows, ".csv"),
    "semicolons": _each(lambda m: files.rows(m, ";"), ".csv"),
    "triplets": _each(files.coordinates, ".txt"),
    "dmig": {"all.pch": files.dmig(NASTRAN).encode()},
    "dmig small": {"all.bdf": programs.dmig_small(NASTRAN).encode()},
    "dmig free": {"all.nas": programs.dmig_free(NASTRAN).encode()},
    "output4": {"all.op4": programs.op4_text(NASTRAN).encode()},
    "output4 strings": {"all.op4": programs.op4_text(NASTRAN, sparse=True, big=True).encode()},
    "output4 binary": {"all.op4": programs.op4_binary(NASTRAN)},
    "output4 binary strings": {"all.op4": programs.op4_binary(NASTRAN, ">", sparse=True)},
    "harwell-boeing": _each(programs.harwell_boeing, ".hb"),
    "ansys": {
        "M.matrix": programs.harwell_boeing(MODEL["M"]).encode(),
        "K.matrix": programs.harwell_boeing(MODEL["K"]).encode(),
        "K.mapping": programs.ansys_mapping().encode(),
        "M.mapping": programs.ansys_mapping().encode(),
    },
    "calculix": {
        "job.sti": programs.calculix(MODEL["K"]).encode(),
        "job.mas": programs.calculix(MODEL["M"]).encode(),
        "job.dof": programs.calculix_dofs().encode(),
    },
}
"""Name of a format -> the files of the model."""
LABELS = (".dof", ".mapping")


def write(folder: Path, contents: Contents) -> list[Path]:
    """Write files; return those of matrices."""
    for name, content in contents.items():
        (folder / name).write_bytes(content)
    return [folder / name for name in contents if not name.endswith(LABELS)]
