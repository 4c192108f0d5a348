"""Files in the layouts of other programs are read to the last digit they have."""

from __future__ import annotations

import gzip
import re
import warnings
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

import vibroimpact as vi
from tests.client import model_files as files
from tests.client import program_files as programs
from tests.client.model_files import LABELS

MODEL = files.model(np.random.default_rng(20))
SINGLE = {name: matrix.astype("f4") for name, matrix in MODEL.items()}
NASTRAN = {"M": "MGG", "K": "KGG", "C": "BGG"}


def _same(model: vi.Model, matrices: dict[str, np.ndarray] = MODEL, rtol: float = 0.0) -> None:
    for name, matrix in matrices.items():
        found = getattr(model, name).toarray()
        np.testing.assert_allclose(found, matrix, rtol=rtol, err_msg=name)


def _nastran(matrices: dict[str, np.ndarray] = MODEL) -> dict[str, np.ndarray]:
    return {NASTRAN[name]: matrix for name, matrix in matrices.items()}


# -- Nastran -------------------------------------------------------------------------------


@pytest.mark.parametrize("sparse", [False, True])
@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("whole", [8, 16])
@pytest.mark.parametrize("digits", [9, 16])
def test_formatted_output4(
    tmp_path: Path, sparse: bool, big: bool, whole: int, digits: int
) -> None:
    path = tmp_path / "model.op4"
    text = programs.op4_text(_nastran(), sparse=sparse, big=big, whole=whole, digits=digits)
    path.write_text(text)
    _same(vi.read_model(path), rtol=0.0 if digits == 16 else 1e-9)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("sparse", [False, True])
@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("word", [4, 8])
@pytest.mark.parametrize("matrices", [MODEL, SINGLE])
def test_binary_output4(
    tmp_path: Path, order: str, sparse: bool, big: bool, word: int,
    matrices: dict[str, np.ndarray],
) -> None:  # fmt: skip
    path = tmp_path / "model.op4"
    form = {"sparse": sparse, "big": big, "word": word}
    path.write_bytes(programs.op4_binary(_nastran(matrices), order, **form))  # type: ignore[arg-type]
    _same(vi.read_model(path), matrices)


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("sparse", [False, True])
def test_neighbours_in_output4_are_skipped_by_name(
    tmp_path: Path, binary: bool, sparse: bool
) -> None:
    """Null, rectangular and complex matrices, and one whose name looks like a number."""
    beside = {
        "NULL": np.zeros((6, 6)), "E16": MODEL["K"][:, :2].copy(), "KAA": MODEL["K"] * (1 + 0.02j),
        "MAA": np.zeros((6, 6)), "UXE": np.ones((6, 9), dtype="c8"), "BAA": MODEL["C"][:, :3],
    }  # fmt: skip
    path = tmp_path / "model.op4"
    for matrices in (beside | _nastran(), _nastran() | beside):
        if binary:
            path.write_bytes(programs.op4_binary(matrices, sparse=sparse))
        else:
            path.write_text(programs.op4_text(matrices, sparse=sparse))
        with pytest.warns(UserWarning, match="not used: ") as said:
            model = vi.read_model(path)
        _same(model)
        assert all(name in str(said[0].message) for name in beside)
    with pytest.raises(ValueError, match="KAA is complex: its imaginary part would be lost"):
        vi.read_model(path, names={"K": "KAA"})


def test_heads_of_strings_have_eleven_characters(tmp_path: Path) -> None:
    """From 1,525 words on they do not fit into eight; glued to nothing, they are read as words."""
    n = 1800
    K = 2.0 * np.eye(n)
    K[:, 0] = K[0] = 1.0
    path = tmp_path / "model.op4"
    path.write_text(programs.op4_text({"MGG": np.eye(n), "KGG": K}, sparse=True, digits=9))
    assert re.search(r"(?m)^ {2}\d{9}$", path.read_text())
    _same(vi.read_model(path), {"M": np.eye(n), "K": K})


def test_truncated_output4_names_the_place(tmp_path: Path) -> None:
    path = tmp_path / "model.op4"
    text = programs.op4_text(_nastran(), sparse=True)
    lines = text.splitlines(keepends=True)
    for cut in range(1, len(lines)):
        if lines[cut - 1].split() == ["1.0000000000000000E+00"]:
            continue  # the end of a matrix: then a matrix is missing
        path.write_text("".join(lines[:cut]))
        with pytest.raises(ValueError, match=r"model\.op4: line \d+: \S"):
            vi.read_model(path)
    data = programs.op4_binary(_nastran(), sparse=True)
    for cut in range(66, len(data), 37):
        path.write_bytes(data[:cut])
        with pytest.raises(ValueError, match=r"model\.op4: byte \d+: |missing"):
            vi.read_model(path)


@pytest.mark.parametrize("suffix", ["pch", "bdf", "dat", "nas"])
@pytest.mark.parametrize(
    "names",
    [("MGG", "KGG", "BGG"), ("MAAX", "KAAX", "BAAX"), ("MAX", "KAX", "BAX"), ("MHH", "KHH", "BHH"),
     ("M2GG", "K2GG", "B2GG"), ("M2PP", "K2PP", "B2PP"), ("MXX", "KXX", "BXX")],
)  # fmt: skip
def test_dmig_of_all_usual_names(tmp_path: Path, suffix: str, names: tuple[str, ...]) -> None:
    path = tmp_path / f"model.{suffix}"
    cards = {name: MODEL[own] for name, own in zip(names, "MKC", strict=True)}
    path.write_text(files.dmig(cards))
    model = vi.read_model(path)
    _same(model, rtol=1e-8)
    assert list(model.labels) == LABELS


def test_dmig_in_small_and_free_fields(tmp_path: Path) -> None:
    path = tmp_path / "model.bdf"
    path.write_text(programs.dmig_small(_nastran()))
    _same(vi.read_model(path), rtol=5e-3)  # three digits
    path.write_text(programs.dmig_free(_nastran()))
    model = vi.read_model(path)
    _same(model)
    assert list(model.labels) == LABELS


def test_dmig_with_entries_on_either_side_of_the_diagonal(tmp_path: Path) -> None:
    """A symmetric matrix has one of them, whichever; a square one both."""
    path = tmp_path / "model.bdf"
    node = {1: "1,1", 2: "2,1", 3: "3,1"}
    head = "DMIG,{0},0,6,2,0\nDMIG,{0},{1},,{1},1.0\nDMIG,{0},{2},,{2},2.0\nDMIG,{0},{3},,{3},3.0\n"
    mass = head.format("MGG", *node.values())
    path.write_text(mass + head.format("KGG", *node.values())
                    + "DMIG,KGG,1,1,,2,1,-0.5\nDMIG,KGG,3,1,,2,1,-0.25\n")  # fmt: skip
    K = [[1.0, -0.5, 0.0], [-0.5, 2.0, -0.25], [0.0, -0.25, 3.0]]
    assert vi.read_model(path).K.toarray().tolist() == K


def test_structural_damping_has_a_meaning(tmp_path: Path) -> None:
    path = tmp_path / "model.pch"
    path.write_text(files.dmig({"MAAX": MODEL["M"], "KAAX": MODEL["K"], "BAAX": MODEL["C"],
                                "K4AAX": 0.04 * MODEL["K"]}))  # fmt: skip
    with pytest.warns(UserWarning, match="K4AAX, structural damping: .* structural_at="):
        _same(vi.read_model(path), rtol=1e-8)
    model = vi.read_model(path, structural_at=20.0)
    _same(model, MODEL | {"C": MODEL["C"] + 0.002 * MODEL["K"]}, rtol=1e-8)
    with pytest.raises(ValueError, match="structural_at is no positive angular frequency: nan"):
        vi.read_model(path, structural_at=float("nan"))


DECK = """\
$ a deck with usual cards
CORD2C  1       0       1.0     0.0     0.0     1.0     0.0     1.0
        2.0     0.0     0.0
GRID    7               1.0     2.0     3.0             46
GRID*   17              1               2.0             90.0
*       0.5
GRID,20,,0.,0.,0.,,456
GRID,21
SPC1    1       123     20      THRU    21
SPC     1       7       3       0.0
SPOINT  99
"""


def test_nodes_and_supports_of_a_deck(tmp_path: Path) -> None:
    deck = tmp_path / "deck.bdf"
    deck.write_text(DECK)
    nodes = vi.read_nodes(deck)
    assert nodes.coordinates[7] == [1.0, 2.0, 3.0]
    np.testing.assert_allclose(nodes.coordinates[17], [1.0, 2.0, 0.5], atol=1e-15)
    assert len(nodes.labels) == 4 * 6 + 1
    held = {(7, "z"), (7, "rx"), (7, "rz")} | {(20, each) for each in ("x", "y", "z", "rx", "ry",
            "rz")} | {(21, each) for each in "xyz"}  # fmt: skip
    assert nodes.held == held
    free = [each for each in nodes.labels if each not in held]
    n = len(free)
    matrices = files.model(np.random.default_rng(21), n)
    path = tmp_path / "model.op4"
    path.write_text(programs.op4_text(_nastran(matrices)))
    model = vi.read_model(path, nodes=deck)
    assert list(model.labels) == free
    assert model.coordinates[20] == [0.0, 0.0, 0.0]
    whole = files.model(np.random.default_rng(22), 25)
    path.write_text(programs.op4_text(_nastran(whole)))
    assert vi.read_model(path, nodes=deck).n == 25
    held_fixed = vi.read_model(path, nodes=deck, supports=True)
    assert list(held_fixed.labels) == free
    other = files.model(np.random.default_rng(22), 9)
    path.write_text(programs.op4_text(_nastran(other)))
    with pytest.raises(ValueError, match=r"25 degrees of freedom, 12 of them held; the matrices"):
        vi.read_model(path, nodes=deck)


@pytest.mark.parametrize(
    ("card", "reason"),
    [("GRID,7\n", "line 12: there are two nodes 7"), ("GRID,x\n", r"line 12: 'x' instead of 1"),
     ("GRID,8,,1.0.0\n", "line 12: '1.0.0' is not a number"),
     ("GRID,8,5\n", "line 12: coordinate system 5 is none of"),
     ("SPC1,1,127,7\n", "line 12: '127' are no components"),
     ("SPC1,1,1,9,THRU,2\n", "line 12: nodes 9 THRU 2"),
     ("CORD2R,5,5,0.,0.,0.,0.,0.,1.\n,1.,0.,0.\nGRID,8,5\n", "coordinate system 5 is none of"),
     ("CORD2R,5,0,0.,0.,0.,0.,0.,1.\n,0.,0.,2.\nGRID,8,5\n", "line 12: the points of")],
)  # fmt: skip
def test_wrong_decks_are_refused(tmp_path: Path, card: str, reason: str) -> None:
    deck = tmp_path / "deck.bdf"
    deck.write_text(DECK + card)
    with pytest.raises(ValueError, match=rf"deck\.bdf: .*{reason}"):
        vi.read_nodes(deck)


# -- ANSYS, CalculiX, Abaqus ---------------------------------------------------------------


@pytest.mark.parametrize("kind", ["RSA", "RUA"])
@pytest.mark.parametrize("right", [False, True])
@pytest.mark.parametrize("form", ["(3D25.16)", "(1P,3D25.16)", "(1P3D25.16)"])
def test_harwell_boeing(tmp_path: Path, kind: str, right: bool, form: str) -> None:
    for name, matrix in MODEL.items():
        (tmp_path / f"{name}.hb").write_text(programs.harwell_boeing(matrix, kind, right, form))
    _same(vi.read_model(*(tmp_path / f"{name}.hb" for name in MODEL)))


def test_hbmat_with_its_mapping(tmp_path: Path) -> None:
    for name, matrix in (("stiff", MODEL["K"]), ("mass", MODEL["M"]), ("damp", MODEL["C"])):
        (tmp_path / f"{name}.matrix").write_text(programs.harwell_boeing(matrix, "RSA", True))
        (tmp_path / f"{name}.mapping").write_text(programs.ansys_mapping())
    model = vi.read_model(*(tmp_path / f"{name}.matrix" for name in ("stiff", "mass", "damp")))
    _same(model)
    assert list(model.labels) == LABELS
    (tmp_path / "mass.mapping").write_text(programs.ansys_mapping().replace("UZ", "TEMP"))
    with pytest.raises(ValueError, match=r"mass\.mapping: line 5: 'TEMP' is no direction"):
        vi.read_model(tmp_path / "stiff.matrix", tmp_path / "mass.matrix")


def test_wrong_harwell_boeing_is_refused(tmp_path: Path) -> None:
    path, whole = tmp_path / "K.hb", programs.harwell_boeing(MODEL["K"])
    lines = whole.splitlines(keepends=True)
    for cut in range(1, len(lines)):
        path.write_text("".join(lines[:cut]))
        with pytest.raises(ValueError, match=r"K\.hb: line \d+: \S"):
            vi.read_model(K=path, M=path)
    for old, new, reason in (
        ("RSA", "PSA", "line 3: a pattern"), ("RSA", "RSE", "line 3: element matrices"),
        ("RSA", "RZA", "line 3: a skew"), ("RSA", "XXA", "line 3: 'XXA' is no type"),
        ("(8I10)", "(what)", "line 4: .* are no formats"),
    ):  # fmt: skip
        path.write_text(whole.replace(old, new))
        with pytest.raises(ValueError, match=reason):
            vi.read_model(K=path, M=path)
    path.write_text(whole.replace("RSA", "CSA"))
    with pytest.raises(ValueError, match="line 3: the matrix is complex"):
        vi.read_model(K=path, M=path)
    start = lines[4]
    path.write_text(whole.replace(start, start.replace("         1", "         2", 1)))
    with pytest.raises(ValueError, match="line 5: columns do not begin"):
        vi.read_model(K=path, M=path)


def test_calculix(tmp_path: Path) -> None:
    (tmp_path / "job.sti").write_text(programs.calculix(MODEL["K"]))
    (tmp_path / "job.mas").write_text(programs.calculix(MODEL["M"]))
    matrices = {name: MODEL[name] for name in ("M", "K")}
    model = vi.read_model(tmp_path / "job.sti", tmp_path / "job.mas")
    _same(model, matrices, rtol=1e-13)
    assert model.labels[3] == (3, "x")
    (tmp_path / "job.dof").write_text(programs.calculix_dofs())
    model = vi.read_model(tmp_path / "job.sti", tmp_path / "job.mas")
    _same(model, matrices, rtol=1e-13)
    assert list(model.labels) == LABELS
    (tmp_path / "job.dof").write_text(programs.calculix_dofs().replace("17.3", "17.9"))
    with pytest.raises(ValueError, match=r"job\.dof: line 4: '17\.9' is no node\.direction"):
        vi.read_model(tmp_path / "job.sti", tmp_path / "job.mas")
    (tmp_path / "job.dof").write_text("7.1\n7.2\n")
    with pytest.raises(ValueError, match=r"job\.dof has 2 rows; the matrix has 6"):
        vi.read_model(tmp_path / "job.sti", tmp_path / "job.mas")


INPUT = """\
*HEADING
** made for a test
*NODE, NSET=ALL
7, 1.0, 2.0, 3.0
17, 0.5, 0., 0.
20, 1.D0, 0., 0.
21, 1., 1., 0.
*NSET, NSET=FOOT, GENERATE
20, 21, 1
*BOUNDARY
FOOT, 1, 2
7, 2
17, PINNED
"""


def test_nodes_of_an_input_deck(tmp_path: Path) -> None:
    deck = tmp_path / "job.inp"
    deck.write_text(INPUT)
    nodes = vi.read_nodes(deck)
    assert nodes.coordinates == {7: [1.0, 2.0, 3.0], 17: [0.5, 0.0, 0.0], 20: [1.0, 0.0, 0.0],
                                 21: [1.0, 1.0, 0.0]}  # fmt: skip
    assert nodes.held == {(20, "x"), (20, "y"), (21, "x"), (21, "y"), (7, "y"), (17, "x"),
                          (17, "y"), (17, "z")}  # fmt: skip
    for name in ("STIF1", "MASS1"):
        matrix = MODEL[{"S": "K", "M": "M"}[name[0]]]
        (tmp_path / f"job_{name}.mtx").write_text(programs.abaqus(matrix, "MATRIX INPUT"))
    paths = tmp_path / "job_STIF1.mtx", tmp_path / "job_MASS1.mtx"
    model = vi.read_model(*paths, nodes=deck, supports=True)
    assert list(model.labels) == [(7, "x"), (21, "ry")]
    expected = MODEL["K"][np.ix_([0, 5], [0, 5])]
    np.testing.assert_allclose(model.K.toarray(), expected, rtol=1e-15)
    deck.write_text(INPUT + "NOWHERE, 1\n")
    with pytest.raises(ValueError, match=r"job\.inp: line 14: 'NOWHERE' instead of 1 whole"):
        vi.read_nodes(deck)


@pytest.mark.parametrize("form", ["MATRIX INPUT", "LABELS", "COORDINATE"])
@pytest.mark.parametrize("part", ["", "PART-1-1."])
def test_abaqus_with_exponents_of_fortran(tmp_path: Path, form: str, part: str) -> None:
    names = {"K": "job_STIF1.mtx", "M": "job_MASS1.mtx", "C": "job_DMPV1.mtx"}
    for which, name in names.items():
        (tmp_path / name).write_text(programs.abaqus(MODEL[which], form, part))
    model = vi.read_model(*(tmp_path / name for name in names.values()))
    _same(model, rtol=1e-15)
    assert model.labels[3] == ((3, "x") if form == "COORDINATE" else (17, "z"))


def test_nodes_of_several_parts_are_refused(tmp_path: Path) -> None:
    text = programs.abaqus(MODEL["K"], "LABELS", "A-1.") + "B-1.7,1, B-1.7,1, 1.0D0\n"
    (tmp_path / "K.mtx").write_text(text)
    with pytest.raises(ValueError, match=r"K\.mtx: line 1: nodes of several parts, A-1, B-1"):
        vi.read_model(K=tmp_path / "K.mtx", M=tmp_path / "K.mtx")


# -- Matlab, numpy, texts ------------------------------------------------------------------


@pytest.mark.parametrize("version", ["5", "7.3"])
@pytest.mark.parametrize("sparse", [False, True])
def test_matlab_structures_and_newer_files(tmp_path: Path, version: str, sparse: bool) -> None:
    path = tmp_path / "model.mat"

    def save(variables: dict[str, object]) -> None:
        if version == "5":
            scipy.io.savemat(path, variables)
        else:
            programs.matlab_73(path, variables, sparse=sparse)

    save(dict(MODEL))
    _same(vi.read_model(path))
    save({"beam": dict(MODEL) | {"name": "a beam"}})
    with pytest.warns(UserWarning, match=r"not used: beam\.name"):
        _same(vi.read_model(path))
    many = {"Mglob": MODEL["M"], "Kglob": MODEL["K"], "Klocal": 2 * MODEL["K"]}
    save(many)
    with pytest.warns(UserWarning, match="not used: Klocal"):
        _same(vi.read_model(path, M="Mglob", K="Kglob"), {k: MODEL[k] for k in "MK"})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with pytest.raises(ValueError, match=r"K='Kother' is no file and no matrix .*Klocal"):
            vi.read_model(path, M="Mglob", K="Kother")


def test_matlab_files_open_no_other_files(tmp_path: Path) -> None:
    other, path = tmp_path / "other.h5", tmp_path / "model.mat"
    with h5py.File(other, "w") as file:
        file["K"] = MODEL["K"]
    with h5py.File(path, "w") as file:
        file["M"] = MODEL["M"]
        file["K"] = h5py.ExternalLink(str(other), "/K")
    with pytest.raises(ValueError, match="K missing"):
        vi.read_model(path)
    raw = tmp_path / "raw.bin"
    MODEL["K"].tofile(raw)
    with h5py.File(path, "w") as file:
        file["M"] = MODEL["M"]
        file.create_dataset("K", (6, 6), "f8", external=[(str(raw), 0, 288)])
    with pytest.raises(ValueError, match=r"model\.mat: the numbers of K are not in this file"):
        vi.read_model(path)


def test_arrays_of_numpy(tmp_path: Path) -> None:
    for name, matrix in MODEL.items():
        np.save(tmp_path / f"{name}.npy", matrix)
    _same(vi.read_model(*(tmp_path / f"{name}.npy" for name in MODEL)))
    np.save(tmp_path / "model_stack.npy", np.array([MODEL[name] for name in "MKC"]))
    _same(vi.read_model(tmp_path / "model_stack.npy"))
    np.save(tmp_path / "K.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(ValueError, match=r"K\.npy: it is no array of numpy that can be read"):
        vi.read_model(tmp_path / "M.npy", tmp_path / "K.npy")


def test_compressed_files(tmp_path: Path) -> None:
    for name, matrix in MODEL.items():
        with gzip.open(tmp_path / f"{name}.mtx.gz", "wt") as file:
            file.write(files.market(matrix))
    _same(vi.read_model(*(tmp_path / f"{name}.mtx.gz" for name in MODEL)))
    data = (tmp_path / "K.mtx.gz").read_bytes()
    for damaged in (data[:-12], b"%%MatrixMarket"):
        (tmp_path / "K.mtx.gz").write_bytes(damaged)
        with pytest.raises(ValueError, match=r"K\.mtx\.gz: it is no archive of gzip"):
            vi.read_model(tmp_path / "M.mtx.gz", tmp_path / "K.mtx.gz")


@pytest.mark.parametrize("comma", [",", ";", "\t"])
def test_tables_with_titles(tmp_path: Path, comma: str) -> None:
    titles = comma.join(f"{node}{part}" for node, part in LABELS)
    titles = comma.join(f"u{k}" for k in range(6)) if comma == "\t" else f"q_{titles}".replace(
        comma, f"{comma}q_")  # fmt: skip
    for name, matrix in MODEL.items():
        text = titles + "\n" + files.rows(matrix, comma)
        (tmp_path / f"{name}.csv").write_bytes(b"\xef\xbb\xbf" + text.encode("latin-1"))
    _same(vi.read_model(*(tmp_path / f"{name}.csv" for name in MODEL)))


def test_tables_of_pandas_with_titles_and_index(tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    for name, matrix in MODEL.items():
        pandas.DataFrame(matrix).to_csv(tmp_path / f"{name}.csv")
    _same(vi.read_model(*(tmp_path / f"{name}.csv" for name in MODEL)))


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("titles", ["", "row,col,value\n"])
def test_entries_in_tables(tmp_path: Path, first: int, titles: str) -> None:
    for name, matrix in MODEL.items():
        rows = [f"{i + first},{j + first},{v!r}\n" for i, j, v in files.everywhere(matrix)]
        (tmp_path / f"{name}.csv").write_text(titles + "".join(rows))
    _same(vi.read_model(*(tmp_path / f"{name}.csv" for name in MODEL)))


@pytest.mark.parametrize("form", ["column", "row", "npy", "npz", "mat"])
def test_a_mass_as_a_vector(tmp_path: Path, form: str) -> None:
    masses = np.diagonal(MODEL["M"]).copy()
    np.savetxt(tmp_path / "K.csv", MODEL["K"], delimiter=",", fmt="%.17g")
    path = tmp_path / f"M.{'csv' if form in ('column', 'row') else form}"
    match form:
        case "column" | "row":
            np.savetxt(path, masses if form == "column" else masses[np.newaxis], fmt="%.17g",
                       delimiter=",")  # fmt: skip
        case "npy":
            np.save(path, masses)
        case "npz":
            np.savez(path, M=masses)
        case _:
            scipy.io.savemat(path, {"M": masses})
    _same(vi.read_model(path, tmp_path / "K.csv"), {"M": np.diag(masses), "K": MODEL["K"]})


def test_a_nearly_symmetric_matrix(tmp_path: Path) -> None:
    uneven = MODEL["K"].copy()
    uneven[0, 1] += 50.0
    np.savez(tmp_path / "model.npz", M=MODEL["M"], K=uneven)
    with pytest.raises(ValueError, match=r"K is not symmetric: .* symmetrize=True"):
        vi.read_model(tmp_path / "model.npz")
    with pytest.warns(UserWarning, match=r"K became symmetric: entries \(0, 1\) and \(1, 0\)"):
        model = vi.read_model(tmp_path / "model.npz", symmetrize=True)
    _same(model, {"K": 0.5 * (uneven + uneven.T)})


def test_labels_are_given(tmp_path: Path) -> None:
    np.savez(tmp_path / "model.npz", **MODEL)
    assert list(vi.read_model(tmp_path / "model.npz", labels=LABELS).labels) == LABELS
    path = tmp_path / "labels.csv"
    path.write_text("node,direction\n" + "".join(f"{node},{part}\n" for node, part in LABELS))
    assert list(vi.read_model(tmp_path / "model.npz", labels=path).labels) == LABELS
    path.write_text(path.read_text().replace("20,y", "20,up"))
    with pytest.raises(ValueError, match=r"labels\.csv: line 6: 'up' is no direction"):
        vi.read_model(tmp_path / "model.npz", labels=path)
    with pytest.raises(ValueError, match="5 labels for 6 degrees of freedom"):
        vi.read_model(tmp_path / "model.npz", labels=LABELS[:5])


@pytest.mark.parametrize("name", ["K.op4", "K.pch", "K.hb", "K.sti", "K.mtx", "K.csv", "K.mat",
                                  "K.npy", "K.npz", "K.mtx.gz"])  # fmt: skip
@pytest.mark.parametrize("content", [b"", b"\n", b"\0" * 100, b"\xff" * 300, b"nan " * 50,
                                     b"9" * 400, b"%", b"$ only a comment\n"])  # fmt: skip
def test_what_is_no_file_of_its_kind_is_refused(tmp_path: Path, name: str, content: bytes) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ValueError, match=re.escape(str(path))):
        vi.read_model(K=path, M=path)


def test_unknown_nodes_are_refused() -> None:
    model = vi.Model(MODEL["M"], MODEL["K"], labels=LABELS)
    assert model.fixed([7], ["x"]).n == 5
    with pytest.raises(ValueError, match="there are no nodes 8, 9"):
        model.fixed([7, 8, 9])
    with pytest.raises(ValueError, match="none of the nodes has a direction 'rx'"):
        model.fixed([7], ["rx"])
