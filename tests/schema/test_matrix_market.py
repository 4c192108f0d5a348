"""Matrix Market texts: every token is checked, and the line at fault is told."""

from __future__ import annotations

import io
import warnings

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sparse

from vibroimpact_schema import matrix_market, number_tables
from vibroimpact_schema.number_tables import NotFiniteError, TextError


def _dense(matrix: matrix_market.Matrix) -> np.ndarray:
    if isinstance(matrix, np.ndarray):
        return matrix
    entries = (matrix.data, (matrix.row, matrix.col))
    return np.asarray(sparse.coo_array(entries, shape=matrix.shape).toarray())


def _read(text: str) -> list[np.ndarray]:
    return [_dense(matrix) for matrix in matrix_market.read(number_tables.plain(text.encode()))]


@pytest.mark.parametrize("form", [np.asarray, sparse.coo_array])
@pytest.mark.parametrize("symmetry", ["general", "symmetric"])
@pytest.mark.parametrize("precision", [None, 5, 17])
def test_what_scipy_writes_is_read(form: object, symmetry: str, precision: int | None) -> None:
    rng = np.random.default_rng(0)
    matrix = rng.normal(size=(9, 9)) * 10.0 ** rng.integers(-300, 300, size=(9, 9))
    matrix = np.where(rng.random((9, 9)) < 0.4, matrix, 0.0)
    matrix = matrix + matrix.T
    buffer = io.BytesIO()
    scipy.io.mmwrite(buffer, form(matrix), symmetry=symmetry, precision=precision)  # type: ignore[operator]
    text = buffer.getvalue().decode()
    expected = scipy.io.mmread(io.StringIO(text), spmatrix=False)
    expected = expected.toarray() if sparse.issparse(expected) else expected
    assert _read(text)[0].tolist() == expected.tolist()


def test_numbers_are_rounded_correctly() -> None:
    """As Python's own, which is exact: each of 20,000 texts gives its float."""
    rng = np.random.default_rng(1)
    texts = [f"{m}.{f:016d}e{e}" for m, f, e in zip(
        rng.integers(-99, 99, 20_000), rng.integers(0, 10**16, 20_000),
        rng.integers(-320, 300, 20_000), strict=True)]  # fmt: skip
    values = number_tables.read("\n".join(texts).encode()).values[:, 0]
    assert values.tolist() == [float(text) for text in texts]


def test_a_million_entries_pass_without_a_loop_over_them() -> None:
    """Memory stays within some copies of the text: lines are no objects."""
    import tracemalloc

    line = b"123 123 1.2345678901234567e+03\n"
    text = b"%%MatrixMarket matrix coordinate real general\n200 200 300000\n" + line * 300_000
    tracemalloc.start()
    try:
        list(matrix_market.read(text))
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 8 * len(text)


@pytest.mark.parametrize(
    ("lines", "line", "reason"),
    [
        (["2 2 1", "", "1 1 2,5"], 4, "decimal comma"),
        (["% c", "2 2 1", "1 1 0x1p3"], 4, "hexadecimal"),
        (["2 2 1", "1 1 1_000"], 3, "'1_000' is not a number"),
        (["2 2 1", "1 1 1e"], 3, "'1e' is not a number"),
        (["2 2 1", "1 1 ."], 3, "'.' is not a number"),
        (["2 2 1", "1 1"], 3, "2 numbers instead of 3"),
        (["2 2 2", "1 1 1", "1 1 1 1"], 4, "4 numbers instead of 3"),
        (["2 2 2", "1 1 1", "3 1 1"], 4, "row 3 of 2, counted from 1"),
        (["2 2 2", "1 1 1", "1 3 1"], 4, "column 3 of 2, counted from 1"),
        (["2 2 2", "0 1 1", "2 2 1"], 3, "row 0 of 2, counted from 1"),
        (["2 2 2", "1 1 1"], 2, "2 entries are announced, 1 follow"),
        (["2 2 0", "1 1 1"], 2, "0 entries are announced, 1 follow"),
        (["2 2", "1 1 1"], 2, "2 numbers instead of rows, columns and entries"),
        (["2 0 0"], 2, "a matrix of 2 rows and 0 columns"),
        (["two 2 2"], 2, "'two 2 2' instead of rows, columns and entries"),
        ([], 1, "the text ends before the sizes"),
    ],
)
def test_faults_are_told_by_line_and_reason(lines: list[str], line: int, reason: str) -> None:
    text = "\n".join(["%%MatrixMarket matrix coordinate real general", *lines, ""])
    with pytest.raises(TextError) as error:
        _read(text)
    assert (error.value.line, reason in error.value.reason) == (line, True), error.value
    second = "%%MatrixMarket matrix coordinate real general\n1 1 1\n1 1 1\n" + text
    with pytest.raises(TextError) as error:
        _read(second)
    assert error.value.line == line + 3


@pytest.mark.parametrize("token", ["nan", "-inf", "Infinity", "1e999", "-1D+400"])
@pytest.mark.parametrize("form", ["coordinate", "array"])
def test_numbers_are_finite(token: str, form: str) -> None:
    size, first = ("2 2 2", "1 1 1\n2 2 ") if form == "coordinate" else ("1 1", "")
    text = f"%%MatrixMarket matrix {form} real general\n{size}\n{first}{token}\n"
    with pytest.raises(
        NotFiniteError, match=f"line {4 if first else 3}: '{token}'".replace("+", r"\+")
    ):
        _read(text)


def test_an_empty_matrix_of_zeros() -> None:
    assert _read("%%MatrixMarket matrix coordinate real symmetric\n2 2 0\n")[0].tolist() == [
        [0.0, 0.0], [0.0, 0.0],
    ]  # fmt: skip


def test_arrays_may_have_several_numbers_in_a_line() -> None:
    text = "%%MatrixMarket matrix array real symmetric\n2 2\n1 2.5D0 % two\n4"
    assert _read(text)[0].tolist() == [[1.0, 2.5], [2.5, 4.0]]
    with pytest.raises(TextError, match="line 4: 'x' is not a number"):
        _read("%%MatrixMarket matrix array real symmetric\n2 2\n1 2.5\nx")


def test_nothing_is_said_by_numpy() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for end in ("", " ", "\t", "\r", "\n\n", "\x1a"):
            assert _read(f"%%MatrixMarket matrix coordinate real general\n1 1 1\n1 1 2{end}")
