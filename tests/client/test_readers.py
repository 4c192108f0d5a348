"""Files as programs and people leave them: read right, or refused with the line and the reason."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sparse

import vibroimpact as vi
from tests.client import model_files as files

Texts = dict[str, bytes]
"""M, K and C -> the content of its file."""


def _market(matrix: np.ndarray, **options: object) -> bytes:
    return files.market(matrix, **options).encode()  # type: ignore[arg-type]


def _fortran(value: float) -> str:
    return f"{value:.16E}".replace("E", "D")


def _without_header(text: bytes) -> bytes:
    return text.partition(b"\n")[2]


def _from_zero(text: bytes) -> bytes:
    head, size, *lines = text.replace(b"% made for a test\n", b"").splitlines()
    moved = [[int(i) - 1, int(j) - 1, v.decode()] for i, j, v in map(bytes.split, lines)]
    return b"\n".join([head, size, *(f"{i} {j} {v}".encode() for i, j, v in moved), b""])


def _comma(text: bytes) -> bytes:
    head, _, body = text.rpartition(b"\n% made for a test\n")
    return head + b"\n" + body.replace(b".", b",")


# Each defect: how a file of Matrix Market is damaged, and whether one can still tell what it means.
MARKET: dict[str, tuple[Callable[[np.ndarray], bytes], bool]] = {
    "as it should be": (_market, True),
    "header lost": (lambda m: _without_header(_market(m)), True),
    "header lost, all entries": (lambda m: _without_header(_market(m, symmetry="general")), True),
    "header in capitals": (lambda m: _market(m).replace(b"matrix coord", b"MATRIX COORD"), True),
    "blank lines before the header": (lambda m: b"\n \n" + _market(m), True),
    "exponents of Fortran": (lambda m: _market(m, value=_fortran), True),
    "carriage returns": (lambda m: _market(m).replace(b"\n", b"\r\n"), True),
    "carriage returns alone": (lambda m: _market(m).replace(b"\n", b"\r"), True),
    "byte order mark": (lambda m: b"\xef\xbb\xbf" + _market(m), True),
    "UTF-16": (lambda m: files.market(m).encode("utf-16"), True),
    "blanks at the ends": (lambda m: _market(m).replace(b"\n", b" \t\n"), True),
    "a blank at the end of the file": (lambda m: _market(m)[:-1] + b" ", True),
    "a tab at the end of the file": (lambda m: _market(m)[:-1] + b"\t", True),
    "a return at the end of the file": (lambda m: _market(m)[:-1] + b"\r", True),
    "no end of the last line": (lambda m: _market(m)[:-1], True),
    "empty lines": (lambda m: _market(m).replace(b"\n", b"\n\n"), True),
    "Latin-1": (lambda m: _market(m).replace(b"made", "für Mühle".encode("latin-1")), True),
    "comments among entries": (lambda m: _market(m) + b"% the end\n", True),
    "counted from zero": (lambda m: _from_zero(_market(m)), True),
    "lower triangle called general": (
        lambda m: _market(m).replace(b"symmetric", b"general"), True),
    "all entries called symmetric": (
        lambda m: _market(m, symmetry="general").replace(b" general", b" symmetric"), True),
    "upper triangle called symmetric": (
        lambda m: _market(np.tril(m).T, symmetry="general").replace(b" general", b" symmetric"),
        True),
    "complex without imaginary parts": (
        lambda m: _market(m, value=lambda v: f"{v!r} 0.0", field="complex"), True),
    "array": (lambda m: _market(m, form="array"), True),
    "array, exponents of Fortran": (lambda m: _market(m, form="array", value=_fortran), True),
    "imaginary parts": (
        lambda m: _market(m, value=lambda v: f"{v!r} {0.02 * v!r}", field="complex"), False),
    "decimal commas": (lambda m: _comma(_market(m)), False),
    "hexadecimal": (lambda m: re.sub(rb" \S+\n$", b" 0x10\n", _market(m)), False),
    "a pattern": (lambda m: re.sub(rb"(?m)^(\d+ \d+) -?\d\S*\.\S*$", rb"\1",
                                   _market(m).replace(b" real", b" pattern")), False),
    "a header without its last word": (lambda m: _market(m).replace(b" symmetric", b""), False),
    "cut between lines": (lambda m: b"\n".join(_market(m).splitlines()[:-2]) + b"\n", False),
    "cut within a line": (lambda m: _market(m)[: _market(m).rstrip().rfind(b" ")], False),
    "header lost and cut": (
        lambda m: b"\n".join(_without_header(_market(m)).splitlines()[:-2]) + b"\n", False),
    "a zero byte at the end": (lambda m: _market(m)[:-1] + b"\0", False),
    "a word": (lambda m: re.sub(rb" \S+\n$", b" stiff\n", _market(m)), False),
    "not a number": (lambda m: re.sub(rb" \S+\n$", b" nan\n", _market(m)), False),
    "an index too large": (lambda m: re.sub(rb"\n\d+ (\d+ \S+)\n$", rb"\n77 \1\n", _market(m)),
                           False),
    "one entry on both sides": (
        lambda m: re.sub(rb"6 6 (\d+)\n", lambda s: b"6 6 %d\n" % (int(s[1]) + 1), _market(m))
        + b"1 2 5.0\n", False),
}  # fmt: skip
OTHERS: dict[str, tuple[str, Callable[[bytes], bytes], bool]] = {
    "list, exponents of Fortran": ("list", lambda t: t.replace(b"e", b"D"), True),
    "list, carriage returns": ("list", lambda t: t.replace(b"\n", b"\r\n"), True),
    "list, byte order mark": ("list", lambda t: b"\xef\xbb\xbf" + t, True),
    "list, a fraction as an index": ("list", lambda t: t.replace(b"2  2 ", b"2.5  2 ", 1), False),
    "list, cut within a line": ("list", lambda t: t[:-9], False),
    "abaqus, exponents of Fortran": ("abaqus", lambda t: t.replace(b"e", b"D"), True),
    "abaqus, commas at the ends": ("abaqus", lambda t: t.replace(b"\n", b",\n"), True),
    "abaqus, Latin-1": ("abaqus", lambda t: t.replace(b"global", b"gl\xf6bal"), True),
    "abaqus, decimal commas": ("abaqus", lambda t: t.replace(b".", b","), False),
    "abaqus, a field is lost": ("abaqus", lambda t: t.rpartition(b", ")[0] + b"\n", False),
    "rows apart by semicolons": ("csv", lambda t: t.replace(b",", b";"), True),
    "rows apart by tabs": ("txt", lambda t: t.replace(b" ", b"\t"), True),
    "rows, exponents of Fortran": (
        "csv", lambda t: re.sub(rb"[\d.]+(?=,|\n)", lambda s: s[0] + b"D0", t), True),
    "rows, commas at the ends": ("csv", lambda t: t.replace(b"\n", b",\n"), True),
    "rows, a byte order mark": ("csv", lambda t: b"\xef\xbb\xbf" + t, True),
    "rows, decimal commas": (
        "csv", lambda t: t.replace(b",", b";").replace(b".", b","), False),
    "rows, an empty field": ("csv", lambda t: t.replace(b"0.0,", b",", 1), False),
    "rows, a line is shorter": ("csv", lambda t: t[: t.rfind(b",")] + b"\n", False),
    "dmig, exponents of Fortran": ("dmig", lambda t: re.sub(rb"E([+-]\d\d)", rb"D\1", t), True),
    "dmig, exponents without letters": (
        "dmig", lambda t: re.sub(rb"E([+-]\d\d)", rb"\1 ", t), True),
    "dmig, Latin-1": ("dmig", lambda t: b"$ Schl\xfcssel\n" + t, True),
    "dmig, carriage returns": ("dmig", lambda t: t.replace(b"\n", b"\r\n"), True),
    "dmig, cut within a line": ("dmig", lambda t: t[:-6], False),
    "dmig, a word": ("dmig", lambda t: re.sub(rb"\S+E[+-]\d\d\n$", b"stiff\n", t), False),
    "output4, exponents of Fortran": (
        "op4", lambda t: t.replace(b"3E23", b"3D23").replace(b"E+", b"D+").replace(b"E-", b"D-"),
        True),
    "output4, cut": ("op4", lambda t: t[: len(t) // 2], False),
    "output4, a number is lost": (
        "op4",
        lambda t: re.sub(rb"\n[ -]\d\.\d+E.\d\d([ -]\d\.\d+E.\d\d)\n", rb"\n\1\n", t, count=1),
        False),
}  # fmt: skip


def _cases() -> list[tuple[str, int]]:
    names = [*MARKET, *OTHERS]
    return [(name, seed) for name in names for seed in range(4)]


def _written(folder: Path, name: str, seed: int) -> tuple[object, bool, dict[str, np.ndarray]]:
    """Write a model with a defect; return how it is read, and whether it can be."""
    matrices = files.model(np.random.default_rng(seed))
    if name in MARKET:
        damage, recoverable = MARKET[name]
        paths = {}
        for which, matrix in matrices.items():
            paths[which] = folder / f"{which}.mtx"
            paths[which].write_bytes(damage(matrix))
        return ((), paths), recoverable, matrices
    form, change, recoverable = OTHERS[name]
    arguments, keywords = files.write(folder, form, matrices)
    for path in [*arguments, *keywords.values()]:
        changed = change(path.read_bytes())
        assert changed != path.read_bytes(), name
        path.write_bytes(changed)
    return (arguments, keywords), recoverable, matrices


def test_usual_defects_are_read_right_or_refused_with_the_line(tmp_path: Path) -> None:
    """Of 260 files, none is read wrong, and all are read that can mean one model only."""
    right = recoverable_files = 0
    for name, seed in _cases():
        folder = tmp_path / f"{name} {seed}"
        folder.mkdir()
        (arguments, keywords), recoverable, matrices = _written(folder, name, seed)  # type: ignore[misc]
        recoverable_files += recoverable
        try:
            model = vi.read_model(*arguments, **keywords)
        except ValueError as error:
            reason = str(error)
        else:
            assert recoverable, f"{name} was read"
            for which, matrix in matrices.items():
                tolerance = 1e-8 if "dmig" in name else 0.0
                found = getattr(model, which).toarray()
                np.testing.assert_allclose(found, matrix, rtol=tolerance, err_msg=name)
            right += 1
            continue
        assert re.search(r"line \d+: \S", reason), (name, reason)
    assert right == recoverable_files


@pytest.mark.parametrize("form", files.FORMS)
@pytest.mark.parametrize("seed", [0, 1])
def test_what_is_well_formed_is_read(tmp_path: Path, form: str, seed: int) -> None:
    matrices = files.model(np.random.default_rng(seed))
    arguments, keywords = files.write(tmp_path, form, matrices)
    model = vi.read_model(*arguments, **keywords)
    for name, matrix in matrices.items():
        rtol = 1e-8 if form == "dmig" else 0.0
        np.testing.assert_allclose(getattr(model, name).toarray(), matrix, rtol=rtol)
    assert list(model.labels)[3] == ((17, "z") if form in {"dmig", "abaqus"} else (3, "x"))


@pytest.mark.parametrize("end", ["", " ", "\t", "\r", "\0", " \0 ", "\n\0"])
@pytest.mark.parametrize("form", ["market", "market-array", "list"])
def test_no_end_of_a_file_ends_the_process(tmp_path: Path, form: str, end: str) -> None:
    matrices = files.model(np.random.default_rng(2))
    _, paths = files.write(tmp_path, form, matrices)
    with paths["K"].open("a+b") as file:
        file.truncate(paths["K"].stat().st_size - 1)
        file.write(end.encode())
    if "\0" in end:
        with pytest.raises(ValueError, match=r"line \d+: .* has bytes that no text has"):
            vi.read_model(**paths)
    else:
        assert vi.read_model(**paths).K.toarray().tolist() == matrices["K"].tolist()


def test_a_size_line_is_no_entry(tmp_path: Path) -> None:
    """As of a public bcsstk01 without its header: 48 48 224 was added to the last entry."""
    matrices = files.model(np.random.default_rng(3), 48)
    for name, matrix in matrices.items():
        (tmp_path / f"{name}.mtx").write_text(files.market(matrix).partition("\n")[2])
    model = vi.read_model(K=tmp_path / "K.mtx", M=tmp_path / "M.mtx")
    assert model.K.toarray().tolist() == matrices["K"].tolist()
    # Where it can be an entry as well, it is not guessed.
    whole = "3 3 3\n1 1 2\n2 2 5\n2 1 1\n"
    (tmp_path / "K.mtx").write_text(whole)
    with pytest.raises(ValueError, match="line 1: it can be an entry, or the size"):
        vi.read_model(K=tmp_path / "K.mtx", M=tmp_path / "K.mtx")
    (tmp_path / "K.mtx").write_text(whole.replace("3 3 3\n", "3 3 3.0\n"))
    model = vi.read_model(K=tmp_path / "K.mtx", M=tmp_path / "K.mtx")
    assert model.K.toarray().tolist() == [[2.0, 1.0, 0.0], [1.0, 5.0, 0.0], [0.0, 0.0, 3.0]]


def test_a_large_first_entry_of_a_list_is_an_entry(tmp_path: Path) -> None:
    (tmp_path / "K.mtx").write_text("2 2 2000000\n1 1 1.5e+06\n2 1 -7.25\n")
    model = vi.read_model(K=tmp_path / "K.mtx", M=tmp_path / "K.mtx")
    assert model.K.toarray().tolist() == [[1.5e6, -7.25], [-7.25, 2e6]]


# -- damping and imaginary parts -----------------------------------------------------------

DAMPING = ("BAAX", "B2GG", "BHH")


@pytest.mark.parametrize("name", DAMPING)
def test_damping_of_nastran_has_several_names(tmp_path: Path, name: str) -> None:
    matrices = files.model(np.random.default_rng(4))
    cards = files.dmig({"MAAX": matrices["M"], "KAAX": matrices["K"], name: matrices["C"]})
    (tmp_path / "model.pch").write_text(cards)
    model = vi.read_model(tmp_path / "model.pch")
    np.testing.assert_allclose(model.C.toarray(), matrices["C"], rtol=1e-8)


def test_structural_damping_is_named_as_not_used(tmp_path: Path) -> None:
    matrices = files.model(np.random.default_rng(5))
    cards = {"MAAX": matrices["M"], "KAAX": matrices["K"], "K4AAX": matrices["C"]}
    (tmp_path / "model.pch").write_text(files.dmig(cards))
    with pytest.warns(UserWarning, match="not used: K4AAX"):
        assert vi.read_model(tmp_path / "model.pch").C is None


def test_imaginary_parts_are_refused_unless_they_are_zero(tmp_path: Path) -> None:
    matrices = files.model(np.random.default_rng(6))
    cards = {"MAAX": matrices["M"], "KAAX": matrices["K"]}
    path = tmp_path / "model.pch"
    path.write_text(files.dmig(cards, {"KAAX": 0.02}))
    with pytest.raises(ValueError, match=r"line \d+: KAAX is complex: its imaginary part would"):
        vi.read_model(path)
    path.write_text(files.dmig(cards, {"KAAX": 0.0}))
    np.testing.assert_allclose(vi.read_model(path).K.toarray(), matrices["K"], rtol=1e-8)
    for suffix, save in ((".mat", scipy.io.savemat), (".npz", lambda p, d: np.savez(p, **d))):
        path = tmp_path / f"model{suffix}"
        save(path, {"M": matrices["M"], "K": matrices["K"] * (1 + 0.02j)})
        with pytest.raises(ValueError, match="K has imaginary parts"):
            vi.read_model(path)
        save(path, {"M": matrices["M"], "K": matrices["K"] * (1 + 0j)})
        assert vi.read_model(path).K.toarray().tolist() == matrices["K"].tolist()


@pytest.mark.parametrize("form", [np.asarray, sparse.csr_array, lambda a: a.tolist()])
def test_systems_and_loads_lose_no_imaginary_parts(form: Callable[[object], object]) -> None:
    M, K = np.eye(2), np.array([[2.0, -1.0], [-1.0, 2.0]])
    lossy = form(np.asarray(K * (1 + 0.02j)))
    with pytest.raises(ValueError, match=r"K has imaginary parts, the largest 0\.04"):
        vi.system(M, lossy, [])
    with pytest.raises(ValueError, match="C has imaginary parts"):
        vi.system(M, K, [], C=lossy)
    with pytest.raises(ValueError, match="K has imaginary parts"):
        vi.Model(M, lossy)
    assert vi.system(M, form(K + 0j), []) == vi.system(M, form(K), [])


@pytest.mark.parametrize("given", [[1.0 + 0.1j, 2.0], np.array([1.0 + 0.1j, 2.0])])
def test_other_numbers_lose_no_imaginary_parts(given: object) -> None:
    structure = vi.oscillator(vi.constraint(0, 0.1))
    for call in (
        lambda: vi.sampled(0, given, interval=0.1),
        lambda: vi.base_motion(given, [0.0, 1.0], interval=0.1),
        lambda: vi.system(np.eye(2), np.eye(2), [], force=given),
        lambda: vi.impact_modes_request(structure, given),
        lambda: vi.time_history_request(structure, (given, [0.0, 0.0]), 1.0, t=[0.0]),
    ):
        with pytest.raises(ValueError, match="imaginary parts"):
            call()


def test_exact_names_win_and_the_others_are_named(tmp_path: Path) -> None:
    """The last one won: C became D, and K k."""
    matrices = files.model(np.random.default_rng(7))
    path = tmp_path / "model.mat"
    wrong = {"k": 7 * matrices["K"], "D": 9 * matrices["C"], "mass": 2 * matrices["M"]}
    for order in (matrices | wrong, wrong | matrices):
        scipy.io.savemat(path, order)
        with pytest.warns(UserWarning, match="not used: ") as said:
            model = vi.read_model(path)
        assert set(str(said[0].message).partition("not used: ")[2].split(", ")) == set(wrong)
        for name, matrix in matrices.items():
            assert getattr(model, name).toarray().tolist() == matrix.tolist()


def test_two_names_of_one_matrix_are_not_chosen_between(tmp_path: Path) -> None:
    matrices = files.model(np.random.default_rng(8))
    path = tmp_path / "model.npz"
    np.savez(path, M=matrices["M"], KAA=matrices["K"], KGG=2 * matrices["K"])
    with pytest.raises(ValueError, match="KAA and KGG can both be K: choose with names="):
        vi.read_model(path)
    with pytest.warns(UserWarning, match="not used: KAA"):
        model = vi.read_model(path, names={"K": "KGG"})
    assert model.K.toarray().tolist() == (2 * matrices["K"]).tolist()


def test_two_files_of_one_matrix_are_not_chosen_between(tmp_path: Path) -> None:
    matrices = files.model(np.random.default_rng(9))
    np.savez(tmp_path / "a.npz", **matrices)
    np.savez(tmp_path / "b.npz", K=2 * matrices["K"])
    with pytest.raises(ValueError, match=r"K in both .*a.npz and .*b.npz"):
        vi.read_model(tmp_path / "a.npz", tmp_path / "b.npz")
    with pytest.warns(UserWarning, match=r"a.npz: not used: K"):
        model = vi.read_model(tmp_path / "a.npz", K=tmp_path / "b.npz")
    assert model.K.toarray().tolist() == (2 * matrices["K"]).tolist()


def test_a_file_that_is_not_used_is_an_error(tmp_path: Path) -> None:
    matrices = files.model(np.random.default_rng(10))
    for name in ("M", "K", "loss"):
        np.savetxt(tmp_path / f"{name}.csv", matrices.get(name, matrices["C"]), delimiter=",")
    with pytest.raises(ValueError, match="does not tell which matrix it is"):
        vi.read_model(*(tmp_path / f"{name}.csv" for name in ("M", "K", "loss")))
    with pytest.raises(ValueError, match="B: matrices are given as M=, K= and C="):
        vi.read_model(tmp_path / "M.csv", tmp_path / "K.csv", B=tmp_path / "loss.csv")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model = vi.read_model(tmp_path / "M.csv", tmp_path / "K.csv", C=tmp_path / "loss.csv")
    assert model.C is not None


@pytest.mark.parametrize(
    "names",
    [("beam_M.mtx", "beam_K.mtx"), ("M_beam.mtx", "K_beam.mtx"), ("m-2.csv", "k-2.csv"),
     ("mass of it.csv", "stiffness of it.csv"), ("c_frame_MASS1.mtx", "c_frame_STIF1.mtx")],
)  # fmt: skip
def test_names_of_files_tell_their_matrices(tmp_path: Path, names: tuple[str, str]) -> None:
    """By the last word of them, and the first where the last says nothing."""
    matrices = files.model(np.random.default_rng(11))
    for name, which in zip(names, "MK", strict=True):
        write = files.market if name.endswith("mtx") else files.rows
        (tmp_path / name).write_text(write(matrices[which]))
    for given in (names, names[::-1]):
        model = vi.read_model(*(tmp_path / name for name in given))
        assert model.M.toarray().tolist() == matrices["M"].tolist()
        assert model.K.toarray().tolist() == matrices["K"].tolist()


def test_single_precision_has_a_way_out(tmp_path: Path) -> None:
    rng = np.random.default_rng(11)
    K = files.model(rng, 30)["K"]
    T = rng.normal(size=(30, 6)).astype(np.float32)
    reduced = (T.T @ (K.astype(np.float32) @ T)).astype(np.float64)
    assert (reduced != reduced.T).any()
    with pytest.raises(ValueError, match=r"K is not symmetric: .* allow it: rounding=") as error:
        vi.Model(np.eye(6), reduced, rounding=1e-10)
    allowed = float(str(error.value).rpartition("rounding=")[2])
    model = vi.Model(np.eye(6), reduced, rounding=allowed)
    np.testing.assert_allclose(model.K.toarray(), 0.5 * (reduced + reduced.T), rtol=1e-15)
    np.savetxt(tmp_path / "K.csv", reduced, delimiter=",")
    np.savetxt(tmp_path / "M.csv", np.eye(6), delimiter=",")
    paths = tmp_path / "M.csv", tmp_path / "K.csv"
    assert vi.read_model(*paths, rounding=allowed).n == 6


# -- Matlab --------------------------------------------------------------------------------


@pytest.mark.parametrize("version", ["4", "5"])
@pytest.mark.parametrize("kind", ["f8", "f4", "i4", "i2", "u1", "c16", ">f8"])
@pytest.mark.parametrize("form", [np.asarray, sparse.csc_array])
def test_matlab_files_as_scipy_reads_them(
    tmp_path: Path, version: str, kind: str, form: Callable[[object], object]
) -> None:
    K = (np.round(files.model(np.random.default_rng(12))["K"] / 1e3) % 7.0).astype(kind)
    K = K + K.T
    path = tmp_path / "model.mat"
    text = {} if version == "4" else {"notes": {"by": "test", "cells": np.array([1, "a"], object)}}
    scipy.io.savemat(path, {"M": np.eye(6), "K": form(K)} | text, format=version)
    with warnings.catch_warnings():
        warnings.simplefilter("error" if not text else "ignore")
        model = vi.read_model(path)
    reference = scipy.io.loadmat(path, spmatrix=False)["K"]
    reference = reference.toarray() if sparse.issparse(reference) else reference
    assert model.K.toarray().tolist() == reference.real.tolist()
    if text:
        with pytest.warns(UserWarning, match="not used: notes"):
            vi.read_model(path)


def test_a_type_of_numbers_that_is_none_does_not_end_the_process(tmp_path: Path) -> None:
    """scipy's reader looks such a type up beyond the end of a table."""
    path = tmp_path / "model.mat"
    scipy.io.savemat(path, {"M": np.eye(3), "K": np.eye(3)})
    tag, other = (
        b"".join(number.to_bytes(4, "little") for number in (kind, 72)) for kind in (9, 144)
    )
    assert tag in path.read_bytes()
    path.write_bytes(path.read_bytes().replace(tag, other))
    with pytest.raises(ValueError, match="it is damaged: numbers of type 144"):
        vi.read_model(path)


def test_newer_files_of_matlab_that_are_damaged_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "model.mat"
    path.write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512) + b"\x89HDF\r\n\x1a\n")
    with pytest.raises(ValueError, match=r"model.mat: it is no file of Matlab 7\.3 that can be"):
        vi.read_model(path)


def test_indices_beyond_a_sparse_matrix_are_refused(tmp_path: Path) -> None:
    """The loops of scipy would write where they point to."""
    path = tmp_path / "K.npz"
    for name, value in (("indices", [0, 10**9]), ("indptr", [0, 9, 2])):
        arrays = {"indices": np.array([0, 1]), "indptr": np.array([0, 1, 2])} | {
            name: np.array(value)
        }
        np.savez(path, format=b"csr", shape=(2, 2), data=np.ones(2), **arrays)
        with pytest.raises(ValueError, match="it is no archive of numpy that can be read"):
            vi.read_model(K=path, M=path)
