"""Models: every file format, labels and coordinates, reductions and their errors."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
import scipy.io
import scipy.linalg
import scipy.sparse as sparse

import vibroimpact as vi

mpl.use("Agg")

K = np.array([[4.0, -1.0, 0.0, 0.5], [-1.0, 3.0, -1.0, 0.0], [0.0, -1.0, 2.0, 0.0], [0.5, 0, 0, 5]])
M = np.diag([1.0, 2.0, 3.0, 4.0]) + 0.1 * np.eye(4)
LABELS = [(7, "x"), (7, "y"), (17, "x"), (17, "z")]


def abaqus(path: Path, matrix: np.ndarray) -> None:
    """Write the lower triangle as ``*MATRIX GENERATE`` does with FORMAT=MATRIX INPUT."""
    components = {"x": 1, "y": 2, "z": 3}
    rows = [
        f"{LABELS[i][0]},{components[LABELS[i][1]]}, {LABELS[j][0]},{components[LABELS[j][1]]}, "
        f"{float(matrix[i, j])!r}"
        for i in range(4) for j in range(i + 1) if matrix[i, j]
    ]  # fmt: skip
    path.write_text("** Assemble\n" + "\n".join(rows))


def write(folder: Path, form: str, mass: np.ndarray = M) -> dict[str, Path]:
    files = {name: folder / f"{name}.{form.partition('-')[0]}" for name in ("M", "K")}
    for name, matrix in (("M", mass), ("K", K)):
        match form:
            case "npz":
                sparse.save_npz(files[name], sparse.csr_array(matrix))
            case "mtx":
                scipy.io.mmwrite(files[name], sparse.coo_array(matrix), symmetry="symmetric")
            case "csv":
                np.savetxt(files[name], matrix, delimiter=",")
            case "mtx-abaqus":
                abaqus(files[name], matrix)
            case "mtx-coordinates":
                entries = sparse.coo_array(matrix)
                rows = zip(entries.row + 1, entries.col + 1, entries.data, strict=True)
                files[name].write_text("\n".join(f"{i} {j} {float(v)!r}" for i, j, v in rows))
    return files


@pytest.mark.parametrize("form", ["npz", "mtx", "csv", "mtx-abaqus", "mtx-coordinates"])
def test_every_format_gives_the_same_matrices(tmp_path: Path, form: str) -> None:
    model = vi.read_model(**write(tmp_path, form))
    np.testing.assert_array_equal(model.M.toarray(), M)
    np.testing.assert_array_equal(model.K.toarray(), K)
    if form == "mtx-abaqus":
        assert list(model.labels) == LABELS


@pytest.mark.parametrize("suffix", [".mat", ".npz"])
def test_one_file_with_all_matrices(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"model{suffix}"
    if suffix == ".mat":
        scipy.io.savemat(path, {"M": sparse.csc_array(M), "K": K, "D": 0.1 * K})
    else:
        np.savez(path, M=M, K=K, C=0.1 * K)
    model = vi.read_model(path)
    np.testing.assert_allclose(model.C.toarray(), 0.1 * K)


def test_nastran_matrices_keep_their_nodes(tmp_path: Path) -> None:
    lines = []
    numbers = {"x": 1, "y": 2, "z": 3}
    for name, matrix in (("KAAX", K), ("MAAX", M)):
        lines.append(f"DMIG    {name:8}{0:8}{6:8}{2:8}{0:8}")
        for j in range(4):
            for i in range(j, 4):
                if matrix[i, j]:
                    (a, b), (c, d) = LABELS[j], LABELS[i]
                    head = f"DMIG*   {name:16}{a:16}{numbers[b]:16}"
                    lines += [head, f"*       {c:16}{numbers[d]:16}{matrix[i, j]:16.9E}"]
    path = tmp_path / "model.pch"
    path.write_text("\n".join(lines) + "\n")
    model = vi.read_model(path)
    assert list(model.labels) == LABELS
    np.testing.assert_allclose(model.K.toarray(), K, rtol=1e-8)
    np.testing.assert_allclose(model.M.toarray(), M, rtol=1e-8)


def test_what_cannot_be_read_is_said(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="known are files ending"):
        vi.read_model(tmp_path / "model.odb")
    np.savez(tmp_path / "model.npz", K=K)
    with pytest.raises(ValueError, match="M missing"):
        vi.read_model(tmp_path / "model.npz")
    with pytest.raises(ValueError, match="not symmetric"):
        vi.Model(M, np.arange(16.0).reshape(4, 4))
    with pytest.raises(ValueError, match="4 different labels"):
        vi.Model(M, K, labels=[(1, "x")] * 4)


def beam(count: int = 20) -> vi.Model:
    """Masses in a row along x that move in z, held at one end; every third has no mass."""
    stiffness = 2.0 * np.eye(count) - np.eye(count, k=1) - np.eye(count, k=-1)
    stiffness[-1, -1] = 1.0
    labels = [(10 + node, "z") for node in range(count)]
    places = {10 + node: (0.5 * node, 0.0) for node in range(count)}
    return vi.Model(np.eye(count), stiffness, labels=labels, coordinates=places)


def test_limiters_are_placed_by_node_and_direction() -> None:
    model = vi.Model(M, K, labels=LABELS)
    assert model.constraint(17, "z", 0.1) == vi.constraint(3, 0.1)
    between = model.constraint(17, "x", {"upper": 0.2}, against=7)
    assert between["direction"] == {"dofs": [2, 0], "weights": [1.0, -1.0]}
    inclined = model.constraint(7, {"x": 0.6, "y": 0.8}, 0.1)
    assert inclined["direction"] == {"dofs": [0, 1], "weights": [0.6, 0.8]}
    with pytest.raises(ValueError, match="node 17 has x, z"):
        model.constraint(17, "y", 0.1)
    assert model.fixed([7]).labels == ((17, "x"), (17, "z"))
    assert model.fixed([7], ["y"]).labels == ((7, "x"), (17, "x"), (17, "z"))
    assert model.system([], {(17, "z"): 2.0})["force"] == [0.0, 0.0, 0.0, 2.0]


def test_shapes_are_drawn_on_the_geometry() -> None:
    model = beam()
    rest, moved = model.displaced(np.arange(20.0), 0.1)
    np.testing.assert_allclose(moved - rest, np.outer(0.1 * np.arange(20.0), [0, 0, 1]))
    ax = model.draw(np.arange(20.0))
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("x", "z")
    assert ax.lines[1].get_ydata()[-1] == pytest.approx(0.95)


@pytest.mark.needs("compiled kernels")
def test_an_animation_goes_there_and_back(tmp_path: Path) -> None:
    tau = np.linspace(-1.0, 1.0, 5)
    animation = beam().animate(tau[:, np.newaxis] * np.arange(20.0))
    animation.save(tmp_path / "mode.gif", writer="pillow", dpi=40)
    assert (tmp_path / "mode.gif").read_bytes().startswith(b"GIF")
    assert len(list(animation.new_frame_seq())) == 8


def test_parts_without_mass_follow_statically() -> None:
    """The finite natural frequencies are those of the pencil, to rounding."""
    model = beam()
    mass = np.diag(np.arange(20) % 3 != 1).astype(float)
    whole = vi.Model(mass, model.K, labels=model.labels)
    reduced = vi.condense(whole)
    squares = scipy.linalg.eigvals(whole.K.toarray(), mass)
    finite = np.sort(squares[np.isfinite(squares) & (np.abs(squares) < 1e6)].real)
    small = scipy.linalg.eigh(
        reduced.model.K.toarray(), reduced.model.M.toarray(), eigvals_only=True
    )
    np.testing.assert_allclose(small, finite, rtol=1e-9)
    assert reduced.model.labels[1] == (12, "z")
    assert reduced.expand(np.ones(reduced.model.n)).shape == (20,)


@pytest.mark.needs("processes")
@pytest.mark.parametrize("form", ["npz", "mtx", "csv", "mtx-abaqus", "mtx-coordinates"])
@pytest.mark.parametrize("massless", [0, 3])
def test_models_without_mass_somewhere_are_read_and_computed(
    tmp_path: Path, form: str, massless: int
) -> None:
    """Files may leave out rows of zeros: the sizes and labels are those of K."""
    mass = np.array(M)
    mass[massless] = mass[:, massless] = 0.0
    model = vi.read_model(**write(tmp_path, form, mass))
    np.testing.assert_array_equal(model.M.toarray(), mass)
    np.testing.assert_array_equal(model.K.toarray(), K)
    structure = model.system([vi.constraint(1, 0.2)])
    shape = vi.Local().impact_modes(structure, [1.2], outputs=["shape"]).shape
    assert shape[0] @ K[massless] == pytest.approx(0.0, abs=1e-14)
    assert shape[0, 1] == 0.2


@pytest.mark.parametrize("modes", [0, 3, 8])
def test_errors_of_reductions_bound_the_true_ones(modes: int) -> None:
    model = beam(60)
    keep = [(69, "z"), (40, "z")]
    reduced = vi.reduce(model, keep, modes, compare=2)
    assert reduced.model.n == 2 + modes
    assert reduced.model.labels[0] == (40, "z")
    true = np.sqrt(scipy.linalg.eigh(model.K.toarray(), model.M.toarray(), eigvals_only=True))
    apart = np.abs(reduced.Omega[:, np.newaxis] / true - 1.0).min(axis=1)
    assert np.all(apart <= reduced.error + 1e-12)
    if modes == 8:
        assert reduced.error[0] < 0.01
    # A static load at the kept degrees of freedom moves the reduced model as the whole one.
    load = np.zeros(model.n)
    load[model.dof(69, "z")] = 1.0
    static = np.linalg.solve(model.K.toarray(), load)
    small = np.linalg.solve(reduced.model.K.toarray(), reduced.T.T @ load)
    np.testing.assert_allclose(reduced.expand(small), static, atol=1e-9)


def test_what_cannot_be_reduced_is_said() -> None:
    with pytest.raises(ValueError, match="there is no node 99"):
        vi.reduce(beam(), [(99, "z")])
    with pytest.raises(ValueError, match="more than 20"):
        vi.reduce(beam(), [(10, "z")], 20)


HEAD = "       3       3       6       2{name:8}1P,3E23.16\n"
END = "       4       1       1\n 1.0000000000000000E+00\n"
MASS = (
    HEAD.format(name="MAA")
    + "       1       1       1\n 2.0000000000000000E+00\n"
    + "       2       2       1\n 3.0000000000000000E+00\n"
    + "       3       3       1\n 4.0000000000000000E+00\n"
    + END
)
# Numbers that fill their field have no blank between them.
DENSE = (
    HEAD.format(name="KAA")
    + "       1       1       2\n 2.5000000000000000E+00-1.0000000000000000E+00\n"
    + "       2       1       3\n-1.0000000000000000E+00 2.0000000000000000E+00"
    + "-5.0000000000000000E-01\n"
    + "       3       2       2\n-5.0000000000000000E-01 7.5000000000000000E-01\n"
    + END
)
# Strings: row + 65536 (words + 1), and with big matrices words + 1 and row.
STRINGS = (
    HEAD.format(name="KAA")
    + "       1       0       5\n  327681\n 2.5000000000000000E+00-1.0000000000000000E+00\n"
    + "       2       0       7\n  458753\n-1.0000000000000000E+00 2.0000000000000000E+00"
    + "-5.0000000000000000E-01\n"
    + "       3       0       5\n  327682\n-5.0000000000000000E-01 7.5000000000000000E-01\n"
    + END
)
BIG = STRINGS.replace("       3       3       6", "       3      -3       6")
BIG = BIG.replace("  327681\n", "       5       1\n").replace("  327682\n", "       5       2\n")
BIG = BIG.replace("  458753\n", "       7       1\n")


@pytest.mark.parametrize("stiffness", [DENSE, STRINGS, BIG])
def test_formatted_output4_of_nastran(tmp_path: Path, stiffness: str) -> None:
    path = tmp_path / "model.op4"
    path.write_text(MASS + stiffness)
    model = vi.read_model(path)
    assert model.M.toarray().tolist() == np.diag([2.0, 3.0, 4.0]).tolist()
    assert model.K.toarray().tolist() == [[2.5, -1.0, 0.0], [-1.0, 2.0, -0.5], [0.0, -0.5, 0.75]]


def test_other_output4_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "model.op4"
    path.write_bytes(b"\x18\0\0\0" + MASS.encode())
    with pytest.raises(ValueError, match="byte 28: a record of 24 bytes does not end here"):
        vi.read_model(path)
    path.write_text(MASS.replace("       2MAA", "       4MAA"))
    with pytest.raises(ValueError, match="MAA is complex"):
        vi.read_model(path)
