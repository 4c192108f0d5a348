"""Files of a small model in the layouts of finite-element programs, written from their manuals.

MSC Nastran 2012 DMAP Programmer's Guide, OUTPUT4; MSC Nastran Quick Reference Guide, DMIG, GRID,
SPC, SPC1, CORD2R, -C, -S; Duff, Grimes, Lewis, Users' Guide for the Harwell-Boeing Sparse Matrix
Collection, 1992; ANSYS Mechanical APDL Command Reference, HBMAT; CalculiX 2.20, matrixstorage.c;
Abaqus Analysis User's Guide, Generating structural matrices; MathWorks, MAT-File Versions.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from pathlib import Path

import h5py
import numpy as np

from tests.client.model_files import COMPONENTS, LABELS, lower

Matrices = Mapping[str, np.ndarray]
WORDS = {1: 1, 2: 2, 3: 2, 4: 4}
"""Type of a matrix of Nastran -> words of four bytes of each number."""


def kind_of(matrix: np.ndarray) -> int:
    """Return the type of a matrix: real or complex, of single or double precision."""
    return {"f4": 1, "f8": 2, "c8": 3, "c16": 4}[matrix.dtype.str[1:]]


def runs(column: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
    """Yield the first row and the entries of each run of entries that are not zero."""
    rows = np.flatnonzero(column)
    for run in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
        if run.size:
            yield int(run[0]), column[run]


def parts(values: np.ndarray) -> list[float]:
    """Return numbers, complex ones as two."""
    real = np.ascontiguousarray(values)
    return [float(v) for v in (real.view(real.real.dtype) if real.dtype.kind == "c" else real)]


# -- Nastran -------------------------------------------------------------------------------


def op4_text(matrices: Matrices, *, sparse: bool = False, big: bool = False, digits: int = 16,
             whole: int = 8) -> str:  # fmt: skip
    """Return formatted OUTPUT4; the head of a string has eleven characters."""
    width, per_line = digits + 7, 80 // (digits + 7)
    text = ""
    for name, matrix in matrices.items():
        rows, columns = matrix.shape
        kind = kind_of(matrix)
        sizes = (columns, -rows if big else rows, 6 if rows == columns else 2, kind)
        text += "".join(f"{v:{whole}}" for v in sizes) + f"{name:8}1P,{per_line}E{width}.{digits}\n"
        for j in range(columns):
            used = np.flatnonzero(matrix[:, j])
            if not used.size:
                continue  # columns without entries are left out
            if sparse:
                strings = list(runs(matrix[:, j]))
                words = sum(len(v) * WORDS[kind] + 1 + big for _, v in strings)
                text += f"{j + 1:{whole}}{0:{whole}}{words:{whole}}\n"
            else:
                strings = [(int(used[0]), matrix[used[0] : used[-1] + 1, j])]
                words = len(strings[0][1]) * WORDS[kind]
                text += f"{j + 1:{whole}}{used[0] + 1:{whole}}{words:{whole}}\n"
            for first, values in strings:
                length = len(values) * WORDS[kind] + 1
                if sparse and big:
                    text += f"{length:{whole}}{first + 1:{whole}}\n"
                elif sparse:
                    text += f"{first + 1 + 65536 * length:11}\n"
                numbers = parts(values)
                for k in range(0, len(numbers), per_line):
                    line = "".join(f"{v:{width}.{digits}E}" for v in numbers[k : k + per_line])
                    text += line + "\n"
        text += f"{columns + 1:{whole}}{1:{whole}}{1:{whole}}\n{1.0:{width}.{digits}E}\n"
    return text


def op4_binary(matrices: Matrices, order: str = "<", *, sparse: bool = False, big: bool = False,
               word: int = 4) -> bytes:  # fmt: skip
    """Return binary OUTPUT4: records with their length before and behind them."""
    whole = f"i{word}"

    def record(*content: bytes) -> bytes:
        body = b"".join(content)
        size = struct.pack(f"{order}i", len(body))
        return size + body + size

    def integers(*values: int) -> bytes:
        return np.array(values, dtype=order + whole).tobytes()

    def numbers(values: np.ndarray) -> bytes:
        kind = values.dtype.str[1:] if word == 4 else {"f4": "f8", "c8": "c16"}.get(
            values.dtype.str[1:], values.dtype.str[1:])  # fmt: skip
        return values.astype(order + kind).tobytes()

    data = b""
    for name, matrix in matrices.items():
        rows, columns = matrix.shape
        sizes = integers(columns, -rows if big else rows, 6, kind_of(matrix))
        data += record(sizes, name.ljust(2 * word).encode())
        for j in range(columns):
            used = np.flatnonzero(matrix[:, j])
            if not used.size:
                continue
            if sparse:
                body = b""
                for first, values in runs(matrix[:, j]):
                    length = len(numbers(values)) // word + 1
                    head = (length, first + 1) if big else (first + 1 + 65536 * length,)
                    body += integers(*head) + numbers(values)
                first_row = 0
            else:
                body = numbers(matrix[used[0] : used[-1] + 1, j])
                first_row = int(used[0]) + 1
            data += record(integers(j + 1, first_row, len(body) // word), body)
        data += record(integers(columns + 1, 1, 1), numbers(np.ones(1)))
    return data


def dmig_small(matrices: Matrices) -> str:
    """Return cards DMIG in small fields: two entries in a line, numbers of eight characters."""
    text = ""
    for name, matrix in matrices.items():
        text += f"DMIG    {name:8}{0:8}{6:8}{1:8}\n"
        for j in range(len(matrix)):
            node, direction = LABELS[j]
            entries = [(i, float(v)) for i, k, v in lower(matrix) if k == j]
            fields = [
                f"{LABELS[i][0]:8}{COMPONENTS[LABELS[i][1]]:8}{short(v):>8}{'':8}"
                for i, v in entries
            ]
            if fields:
                text += f"DMIG    {name:8}{node:8}{COMPONENTS[direction]:8}{'':8}{fields[0]}\n"
            for k in range(1, len(fields), 2):
                text += f"{'+':8}{''.join(fields[k : k + 2])}\n"
    return text


def short(value: float) -> str:
    """Return a number in eight characters, its exponent without a letter: -1.23+4."""
    mantissa, _, exponent = f"{value:.2e}".partition("e")
    return f"{mantissa}{int(exponent):+d}"


def dmig_free(matrices: Matrices) -> str:
    """Return cards DMIG in free fields, numbers with all digits."""
    text = "$ made for a test, with a comment, and a comma\n"
    for name, matrix in matrices.items():
        text += f"DMIG,{name},0,6,2,0\n"
        for j in range(len(matrix)):
            node, direction = LABELS[j]
            entries = [(i, float(v)) for i, k, v in lower(matrix) if k == j]
            if entries:
                text += f"DMIG*,{name},{node},{COMPONENTS[direction]}\n"
            for i, v in entries:
                text += f"*,{LABELS[i][0]},{COMPONENTS[LABELS[i][1]]},{v!r}\n"
    return text


# -- Harwell-Boeing, ANSYS, CalculiX, Abaqus -----------------------------------------------


def harwell_boeing(matrix: np.ndarray, kind: str = "RSA", right: bool = False,
                   form: str = "(3D25.16)") -> str:  # fmt: skip
    """Return a matrix by columns, one triangle of symmetric ones, exponents with D."""
    n = len(matrix)
    used = np.tril(matrix) if kind[1] == "S" else matrix
    starts, index, values = [1], [], []
    for j in range(n):
        rows = np.flatnonzero(used[:, j])
        index += [int(i) + 1 for i in rows]
        values += [float(v) for v in used[rows, j]]
        starts.append(len(index) + 1)
    per_line = int(form[form.index("D") - 1])

    def lines(numbers: list[str], count: int) -> str:
        return "".join(
            "".join(numbers[k : k + count]) + "\n" for k in range(0, len(numbers), count)
        )

    def real(value: float) -> str:
        return f"{value:25.16E}".replace("E", "D")

    body = [lines([f"{v:10}" for v in starts], 8), lines([f"{v:10}" for v in index], 8),
            lines([real(v) for v in values], per_line)]  # fmt: skip
    loads = lines([real(1.0)] * n, per_line) if right else ""
    counts = [part.count("\n") for part in [*body, loads]]
    head = f"{'made for a test':72}{'TEST':8}\n"
    head += "".join(f"{v:14}" for v in (sum(counts), *counts)) + "\n"
    head += f"{kind:3}{'':11}{n:14}{n:14}{len(index):14}{0:14}\n"
    head += f"{'(8I10)':16}{'(8I10)':16}{form:20}{form if right else '':20}\n"
    if right:
        head += f"{'F':3}{'':11}{1:14}{0:14}\n"
    return head + "".join(body) + loads


def ansys_mapping() -> str:
    """Return the mapping of HBMAT: equations, nodes and degrees of freedom."""
    names = {"x": "UX", "y": "UY", "z": "UZ", "ry": "ROTY"}
    rows = [f"{row:11}{node:12}  {names[part]:4}\n" for row, (node, part) in enumerate(LABELS, 1)]
    return " Matrix Eqn        Node  DOF\n" + "".join(rows)


def calculix(matrix: np.ndarray) -> str:
    """Return the upper triangle column by column, with the zeros that CalculiX stores."""
    text = ""
    for j in range(len(matrix)):
        for i in range(j + 1):
            if matrix[i, j] or (i + j) % 2:
                text += f"{i + 1} {j + 1} {matrix[i, j]:20.13e}\n"
    return text


def calculix_dofs() -> str:
    return "".join(f"{node}.{COMPONENTS[part]}\n" for node, part in LABELS)


def abaqus(matrix: np.ndarray, form: str, part: str = "") -> str:
    """Return a matrix as of ``*MATRIX OUTPUT, FORMAT=`` MATRIX INPUT, LABELS or COORDINATE."""
    if form == "COORDINATE":
        return "".join(f"{i + 1:10}{j + 1:10} {v:23.15E}\n".replace("E", "D")
                       for i, j, v in lower(matrix))  # fmt: skip

    def end(row: int) -> str:
        return f"{part}{LABELS[row][0]},{COMPONENTS[LABELS[row][1]]}"

    sign = "*MATRIX INPUT, NAME=STIF\n" if form == "MATRIX INPUT" else "** labels\n"
    return sign + "".join(f"{end(i)}, {end(j)}, {v:23.15E}\n".replace("E", "D")
                          for i, j, v in lower(matrix))  # fmt: skip


# -- Matlab 7.3 ----------------------------------------------------------------------------


def matlab_73(path: Path, variables: Mapping[str, object], *, sparse: bool = False) -> None:
    """Write what ``save(..., "-v7.3")`` writes: 512 bytes of text, then HDF5."""

    def store(group: h5py.Group, name: str, value: object) -> None:
        if isinstance(value, Mapping):
            inner = group.create_group(name)
            inner.attrs["MATLAB_class"] = np.bytes_("struct")
            for key, each in value.items():
                store(inner, key, each)
        elif isinstance(value, str):
            text = np.array([[ord(sign)] for sign in value], dtype="u2")
            group.create_dataset(name, data=text).attrs["MATLAB_class"] = np.bytes_("char")
        elif sparse:
            inner = group.create_group(name)
            inner.attrs["MATLAB_class"] = np.bytes_("double")
            matrix = np.asarray(value)
            inner.attrs["MATLAB_sparse"] = np.uint64(len(matrix))
            column, row = np.nonzero(matrix.T)
            starts = np.concatenate([[0], np.cumsum(np.bincount(column, minlength=len(matrix)))])
            inner["data"], inner["ir"] = matrix[row, column], row.astype("u8")
            inner["jc"] = starts.astype("u8")
        else:
            found = group.create_dataset(name, data=np.asarray(value).T)
            found.attrs["MATLAB_class"] = np.bytes_("double")

    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in variables.items():
            store(file, name, value)
    with path.open("r+b") as head:
        head.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: today".ljust(512))


def tube(folder: Path, elements: int = 40) -> None:
    """Write a clamped tube of Euler-Bernoulli elements in space: tube.op4 and tube.bdf."""
    length, E, G, rho, outer, inner = 2.0, 2.1e11, 8.0e10, 7850.0, 0.025, 0.022
    h, A = length / elements, np.pi * (outer**2 - inner**2)
    inertia = np.pi / 4 * (outer**4 - inner**4)
    bend = np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h * h, -6 * h, 2 * h * h],
                     [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h * h, -6 * h, 4 * h * h]])  # fmt: skip
    move = np.array([[156, 22 * h, 54, -13 * h], [22 * h, 4 * h * h, 13 * h, -3 * h * h],
                     [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h * h, -22 * h, 4 * h * h]]
                    )  # fmt: skip
    rod, along = np.array([[1.0, -1.0], [-1.0, 1.0]]), np.array([[2.0, 1.0], [1.0, 2.0]])
    flip = np.diag([1.0, -1.0, 1.0, -1.0])  # rotations about y turn the other way
    n = 6 * (elements + 1)
    M, K = np.zeros((n, n)), np.zeros((n, n))
    parts = [
        ([0, 6], E * A / h * rod, rho * A * h / 6 * along),
        ([3, 9], G * 2 * inertia / h * rod, rho * 2 * inertia * h / 6 * along),
        ([1, 5, 7, 11], E * inertia / h**3 * bend, rho * A * h / 420 * move),
        ([2, 4, 8, 10], E * inertia / h**3 * flip @ bend @ flip,
         rho * A * h / 420 * flip @ move @ flip),
    ]  # fmt: skip
    for element in range(elements):
        for ends, k, m in parts:
            dofs = np.ix_(6 * element + np.array(ends), 6 * element + np.array(ends))
            K[dofs] += k
            M[dofs] += m
    (folder / "tube.op4").write_text(op4_text({"MGG": M, "KGG": K}, sparse=True))
    grids = [
        f"GRID    {k + 1:8}        {k * h:8.4f}     0.0     0.0\n" for k in range(elements + 1)
    ]
    bars = [f"CBAR    {k:8}       1{k:8}{k + 1:8}     0.0     0.0     1.0\n"
            for k in range(1, elements + 1)]  # fmt: skip
    deck = ["SOL 103\nBEGIN BULK\n", *grids, *bars, "SPC1           1  123456       1\nENDDATA\n"]
    (folder / "tube.bdf").write_text("".join(deck))
