"""Files of a small model in every format that is read, as the programs write them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
import scipy.sparse as sparse

LABELS = [(7, "x"), (7, "y"), (17, "x"), (17, "z"), (20, "y"), (21, "ry")]
COMPONENTS = {"x": 1, "y": 2, "z": 3, "ry": 5}


def model(rng: np.random.Generator, n: int = 6) -> dict[str, np.ndarray]:
    """Return M, K and C with entries that need all digits, M with a row of zeros at times."""
    K = np.diag(rng.uniform(2.0, 5.0, n) * 1e4)
    for i in range(n - 1):
        K[i, i + 1] = K[i + 1, i] = rng.normal() * 1e3
    K[0, -1] = K[-1, 0] = rng.normal() * 1e2
    M = np.diag(rng.uniform(0.5, 1.5, n))
    M[0, 1] = M[1, 0] = 0.1 * rng.uniform()
    return {"M": M, "K": K, "C": 1e-3 * K}


def lower(matrix: np.ndarray) -> list[tuple[int, int, float]]:
    return [
        (i, j, float(matrix[i, j])) for j in range(len(matrix)) for i in range(j, len(matrix))
        if matrix[i, j]
    ]  # fmt: skip


def everywhere(matrix: np.ndarray) -> list[tuple[int, int, float]]:
    return [(int(i), int(j), float(matrix[i, j])) for i, j in np.argwhere(matrix)]


def market(matrix: np.ndarray, form: str = "coordinate", symmetry: str = "symmetric",
           value: Callable[[float], str] = repr, field: str = "real") -> str:  # fmt: skip
    """Return Matrix Market text, its lines ending with line feeds."""
    n = len(matrix)
    head = f"%%MatrixMarket matrix {form} {field} {symmetry}\n% made for a test\n"
    if form == "array":
        first = range(n) if symmetry == "symmetric" else [0] * n
        numbers = [float(matrix[i, j]) for j in range(n) for i in range(first[j], n)]
        return head + f"{n} {n}\n" + "".join(f"{value(v)}\n" for v in numbers)
    entries = lower(matrix) if symmetry == "symmetric" else everywhere(matrix)
    lines = [f"{i + 1} {j + 1} {value(v)}\n" for i, j, v in entries]
    return head + f"{n} {n} {len(entries)}\n" + "".join(lines)


def dense(matrix: Any) -> np.ndarray:
    """Return the array of a matrix in a document."""
    if isinstance(matrix, list):
        return np.array(matrix)
    if "scalar" in matrix:
        return matrix["scalar"] * np.eye(matrix["n"])
    places = (matrix["row"], matrix["col"])
    return sparse.coo_array((matrix["data"], places), shape=matrix["shape"]).toarray()


def coordinates(matrix: np.ndarray) -> str:
    return "".join(f"{i + 1}  {j + 1}  {v:.16e}\n" for i, j, v in everywhere(matrix))


def abaqus(matrix: np.ndarray) -> str:
    def end(row: int) -> str:
        return f"{LABELS[row][0]},{COMPONENTS[LABELS[row][1]]}"

    rows = [f"{end(i)}, {end(j)}, {v:.16e}\n" for i, j, v in lower(matrix)]
    return "** Assembled global matrix\n" + "".join(rows)


def rows(matrix: np.ndarray, delimiter: str = ",") -> str:
    return "".join(delimiter.join(f"{float(v)!r}" for v in row) + "\n" for row in matrix)


def dmig(
    matrices: Mapping[str, np.ndarray], imaginary: Mapping[str, float] | None = None, form: int = 6
) -> str:
    """Return cards DMIG in large fields; `imaginary`: loss factors by name."""
    lines = []
    for name, matrix in matrices.items():
        loss = (imaginary or {}).get(name, 0.0)
        kind = 4 if name in (imaginary or {}) else 2
        lines.append(f"DMIG    {name:8}{0:8}{form:8}{kind:8}{0:8}")
        for column in range(len(matrix)):
            entries = [(i, v) for i, j, v in lower(matrix) if j == column]
            if entries:
                node, direction = LABELS[column]
                lines.append(f"DMIG*   {name:16}{node:16}{COMPONENTS[direction]:16}")
            for i, v in entries:
                node, direction = LABELS[i]
                second = f"{loss * v:16.9E}" if kind == 4 else ""
                lines.append(f"*       {node:16}{COMPONENTS[direction]:16}{v:16.9E}{second}")
    return "\n".join(lines) + "\n"


def output4(matrices: Mapping[str, np.ndarray]) -> str:
    """Return formatted OUTPUT4, columns without their zeros at both ends."""
    text = ""
    for name, matrix in matrices.items():
        n = len(matrix)
        text += f"{n:8}{n:8}{6:8}{2:8}{name:8}1P,3E23.16\n"
        for j in range(n):
            used = np.flatnonzero(matrix[:, j])
            if used.size:
                column = matrix[used[0] : used[-1] + 1, j]
                text += f"{j + 1:8}{used[0] + 1:8}{len(column):8}\n"
                for k in range(0, len(column), 3):
                    text += "".join(f"{v:23.16E}" for v in column[k : k + 3]) + "\n"
        text += f"{n + 1:8}{1:8}{1:8}\n{1.0:23.16E}\n"
    return text


def write(folder: Path, form: str, matrices: Mapping[str, np.ndarray]) -> tuple[Any, ...]:
    """Write a model and return the arguments and keywords of `read_model`."""
    folder.mkdir(parents=True, exist_ok=True)
    one = {"mat5", "mat4", "mat-sparse", "savez", "dmig", "op4"}
    if form in one:
        path = folder / f"model.{ {'savez': 'npz', 'dmig': 'pch', 'op4': 'op4'}.get(form, 'mat') }"
        if form == "savez":
            np.savez(path, **matrices)
        elif form == "dmig":
            path.write_text(dmig({"MKC"["MKC".index(k)] + "AAX": v for k, v in matrices.items()}
                                 | {}).replace("CAAX", "BAAX"))  # fmt: skip
        elif form == "op4":
            path.write_text(output4({("B" if k == "C" else k) + "AA": v
                                     for k, v in matrices.items()}))  # fmt: skip
        else:
            kept = {k: sparse.csc_array(v) if form == "mat-sparse" else v
                    for k, v in matrices.items()}  # fmt: skip
            scipy.io.savemat(path, kept, format="4" if form == "mat4" else "5",
                             do_compression=form == "mat-sparse")  # fmt: skip
        return (path,), {}
    files: dict[str, Path] = {}
    for name, matrix in matrices.items():
        suffix = {"csv": "csv", "txt": "txt", "npz": "npz"}.get(form, "mtx")
        files[name] = path = folder / f"{name}.{suffix}"
        if form == "npz":
            sparse.save_npz(path, sparse.csr_array(matrix))
            continue
        text = {
            "csv": lambda m: rows(m),
            "txt": lambda m: rows(m, " "),
            "abaqus": abaqus,
            "list": coordinates,
            "market": market,
            "market-general": lambda m: market(m, symmetry="general"),
            "market-array": lambda m: market(m, form="array"),
        }[form](matrix)
        path.write_text(text)
    return (), files


FORMS = ("mat5", "mat4", "mat-sparse", "savez", "npz", "dmig", "op4", "csv", "txt", "abaqus",
         "list", "market", "market-general", "market-array")  # fmt: skip
