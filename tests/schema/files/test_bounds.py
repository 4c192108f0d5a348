"""Claims of files take neither time nor memory: they are refused before anything is allocated."""

from __future__ import annotations

import contextlib
import gzip
import io
import time
import tracemalloc
import zipfile
import zlib

import numpy as np
import pytest

from tests.client import program_files as programs
from tests.schema.files.uploads import FORMATS
from vibroimpact_schema.files import file_bytes, label_texts, readers, structures
from vibroimpact_schema.files.bounds import Bounds, TooLargeError, TooManyRowsError

BOUNDS = Bounds(size=2**20, lines=2**16, rows=5000)
HUGE = (10**9, 10**12)


def _head(text: str) -> bytes:
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode()


def _zip(name: str, content: bytes) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, content)
    return buffer.getvalue()


def _claims(n: int) -> dict[str, bytes]:
    """Return files whose heads claim n rows or n entries."""
    market = "%%MatrixMarket matrix"
    shape = f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({n}, {n}), }}\n"
    counts = f"{'':>14}{'':>14}{'':>14}{'':>14}".replace(" ", "1")
    boeing = f"{'made for a test':72}{'TEST':8}\n{counts}\nRSA{'':11}{{rows:14}}{{rows:14}}"
    boeing += "{entries:14}\n(8I10)          (8I10)          (3E25.16)\n         1\n"
    words = np.array([n, n, 6, 2], dtype="<i8").tobytes() + b"KGG".ljust(16)
    return {
        "size.mtx": f"{market} coordinate real general\n{n} {n} {n}\n1 1 1.0\n".encode(),
        "entries.mtx": f"{market} coordinate real general\n5000 5000 {n}\n1 1 1.0\n".encode(),
        "array.mtx": f"{market} array real symmetric\n{n} {n}\n1.0\n".encode(),
        "list.mtx": f"1 1 1.0\n{n} {n} 1.0\n".encode(),
        "job.sti": f"1 1 1.0\n{n} {n} 1.0\n".encode(),
        "list.csv": f"row,col,value\n{n},{n},1.0\n".encode(),
        "rows.npy": _head(shape),
        "rows.npz": _zip("K.npy", _head(shape)),
        "rows.hb": boeing.format(rows=n, entries=1).encode(),
        "entries.hb": boeing.format(rows=3, entries=n).encode(),
        "rows.op4": f"{n:16}{n:16}{6:16}{2:16}KGG     1P,3E23.16\n{1:16}{1:16}{n:16}\n".encode(),
        "binary.op4": b"".join([(48).to_bytes(4, "little"), words, (48).to_bytes(4, "little")]),
        "nodes.dmig.pch": b"DMIG,KGG,0,6,2,0\nDMIG*,KGG,%d,1\n*,%d,1,1.0\n" % (n, n),
    }  # fmt: skip


# A node may have any number, so that what DMIG claims by one is a matrix of one row.
REFUSED = sorted(set(_claims(1)) - {"nodes.dmig.pch"})


def _spent(call: object) -> tuple[float, int]:
    """Return the processor time of a call that is refused, and the memory that it took."""
    tracemalloc.start()
    began = time.process_time()
    try:
        with pytest.raises(ValueError, match=r"\S"):
            call()  # type: ignore[operator]
        return time.process_time() - began, tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("n", HUGE)
@pytest.mark.parametrize("name", REFUSED)
def test_what_a_head_claims_is_refused_at_once(name: str, n: int) -> None:
    data = _claims(n)[name]

    def read() -> None:
        structures.select(name, readers.read(name, data, BOUNDS), "K", bounds=BOUNDS)

    read_once = [_spent(read) for _ in range(3)]
    assert min(seconds for seconds, _ in read_once) < 0.05
    assert max(peak for _, peak in read_once) < 2**20


def test_a_node_may_have_any_number() -> None:
    name = "nodes.dmig.pch"
    content = readers.read(name, _claims(10**9)[name], BOUNDS)
    assert content.matrices["KGG"].shape == (1, 1)
    with pytest.raises(ValueError, match="line 3: a node or component has too large a number"):
        readers.read(name, _claims(10**12 * 10)[name], BOUNDS)


@pytest.mark.parametrize("packed", [gzip.compress(bytes(2**26)), gzip.compress(b"1 " * 2**25)])
def test_archives_are_unpacked_as_far_as_the_bounds_allow(packed: bytes) -> None:
    assert len(packed) < 2**17
    seconds, peak = _spent(lambda: file_bytes.unpacked("K.mtx.gz", packed, BOUNDS))
    assert seconds < 0.5
    assert peak < 8 * 2**20
    with pytest.raises(TooLargeError, match="unpacked it is larger than 1048576 bytes"):
        readers.read("K.mtx.gz", packed, BOUNDS)
    bomb = _zip("K.npy", bytes(2**26))
    _, peak = _spent(lambda: readers.read("K.npz", bomb, BOUNDS))
    assert peak < 8 * 2**20
    with pytest.raises(TooLargeError, match="unpacked it is larger"):
        readers.read("K.npz", bomb, BOUNDS)


def test_damaged_archives_are_refused() -> None:
    packed = bytearray(gzip.compress(b"1 0\n0 1\n"))
    packed[-6] ^= 255
    for data in (b"no archive", bytes(packed), bytes(packed[:-9]), zlib.compress(b"1")):
        with pytest.raises(ValueError, match="no archive of gzip that can be read"):
            file_bytes.unpacked("K.mtx.gz", data)


def test_lines_matrices_and_rows_are_counted_first() -> None:
    few = Bounds(lines=10, rows=3)
    for name in ("K.op4", "K.hb", "K.pch"):
        with pytest.raises(TooLargeError, match="11 lines are more than 10"):
            readers.read(name, b"1\n" * 10, few)
    with pytest.raises(TooLargeError, match="11 lines"):
        label_texts.read("job.dof", b"1.1\n" * 10, few)
    text = "".join(
        programs.op4_text({f"A{k}": np.eye(1)}) for k in range(1001)
    )  # fmt: skip
    with pytest.raises(TooLargeError, match="more than 1000 matrices"):
        readers.read("K.op4", text.encode())
    cards = "".join(f"DMIG,A{k},0,6,2,0\nDMIG*,A{k},1,1\n*,1,1,2.0\n" for k in range(1001))
    with pytest.raises(TooLargeError, match="more than 1000 matrices"):
        readers.read("K.pch", cards.encode())
    for name in ("market", "npy", "csv"):
        (file, data), *_ = FORMATS[name].items()
        with pytest.raises(TooManyRowsError, match="a matrix of 6 rows; at most 3 are read"):
            structures.select(file, readers.read(file, data, few), "K", bounds=few)


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("K.hb", FORMATS["harwell-boeing"]["K.hb"] + b"1" * 2**20),
        ("K.op4", b"1" * 2**20),
        ("K.op4", b"\n" * 2**15 + b"1" * 2**20),
        ("K.op4", FORMATS["output4"]["all.op4"].replace(b"1P,3E23.16", b"1P,3E00.16")),
        ("K.hb", FORMATS["harwell-boeing"]["K.hb"].replace(b"(8I10)", b"(0I10)")),
        ("K.hb", FORMATS["harwell-boeing"]["K.hb"].replace(b"(3D25.16)", b"(3D99999999)")),
        ("K.hb", FORMATS["harwell-boeing"]["K.hb"].replace(b"(8I10)", b"1" * 2**20)),
        ("K.pch", b"DMIG,K,0,6,2,0\n" + b"\t" * 2**20),
        ("K.mtx", b"1 " * 2**20 + b"x"),
        ("K.mtx", b'"' * 2**20 + b"A.1,1,1,1,1.0"),
        ("K.csv", b"a," * 2**20),
    ],
)  # fmt: skip
def test_lines_without_end_are_read_or_refused_in_linear_time(name: str, data: bytes) -> None:
    """A pattern that begins anew at every character would take hours."""
    tracemalloc.start()
    began = time.process_time()
    with contextlib.suppress(ValueError):
        structures.select(name, readers.read(name, data, BOUNDS), "K", bounds=BOUNDS)
    seconds, (_, peak) = time.process_time() - began, tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert seconds < 10.0
    assert peak < 400 * 2**20
