"""Files of matrices: sent as they are, and what is said of those that are not read."""

from __future__ import annotations

import gzip
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sparse
from playwright.sync_api import Page, expect

from tests.browser.visits import Visit
from tests.client import program_files

N = 5
M = np.diag(np.linspace(1.0, 2.0, N))
K = 2.5 * np.eye(N) - np.eye(N, k=1) - np.eye(N, k=-1)


def _numpy(folder: Path) -> list[str]:
    np.savez(folder / "model.npz", M=M, K=np.asfortranarray(K))
    return ["model.npz"]


def _compressed(folder: Path) -> list[str]:
    np.savez_compressed(folder / "model.npz", mass=M.astype(np.float32), stiffness=K)
    return ["model.npz"]


def _scipy(folder: Path) -> list[str]:
    sparse.save_npz(folder / "M.npz", sparse.csr_array(M))
    sparse.save_npz(folder / "K.npz", sparse.csc_array(K))
    return ["K.npz", "M.npz"]


def _coordinates(folder: Path) -> list[str]:
    sparse.save_npz(folder / "M.npz", sparse.coo_array(M))
    np.save(folder / "K.npy", K)
    return ["M.npz", "K.npy"]


def _text(folder: Path) -> list[str]:
    np.savetxt(folder / "M.csv", M, delimiter=",", header="mass")
    np.savetxt(folder / "K.txt", np.tril(K))
    return ["M.csv", "K.txt"]


def _abaqus(folder: Path) -> list[str]:
    entries = [(i, j) for i in range(N) for j in range(i + 1)]
    for name, matrix in (("M", M), ("K", K)):
        lines = [f"{i + 1},2, {j + 1},2, {matrix[i, j]:.17e}" for i, j in entries if matrix[i, j]]
        (folder / f"{name}.mtx").write_text("** matrix\n" + "\n".join(lines))
    return ["M.mtx", "K.mtx"]


def _market(folder: Path) -> list[str]:
    scipy.io.mmwrite(folder / "M.mtx", sparse.coo_array(M))
    np.savetxt(folder / "K.csv", K, delimiter=";")
    return ["M.mtx", "K.csv"]


def _beside_market(folder: Path) -> list[str]:
    """Texts beside one another, with exponents as Fortran writes them."""
    scipy.io.mmwrite(folder / "M.mtx", sparse.coo_array(M), symmetry="symmetric")
    text = (folder / "M.mtx").read_text()
    (folder / "M.mtx").write_text(text.replace("\n", " \r\n"))
    lines = [" ".join(f"{value:.16E}".replace("E", "D") for value in row) for row in np.tril(K)]
    (folder / "K.txt").write_text("\n".join(lines))
    return ["M.mtx", "K.txt"]


def _nastran(folder: Path) -> list[str]:
    data = program_files.op4_binary({"MGG": M, "KGG": K}, sparse=True)
    (folder / "model.op4").write_bytes(data)
    return ["model.op4"]


def _calculix(folder: Path) -> list[str]:
    (folder / "job.sti").write_text(program_files.calculix(K))
    (folder / "job.mas.gz").write_bytes(gzip.compress(program_files.calculix(M).encode()))
    return ["job.sti", "job.mas.gz"]


def _dense(matrix: Any) -> np.ndarray:
    if isinstance(matrix, list):
        return np.array(matrix)
    if "scalar" in matrix:
        return matrix["scalar"] * np.eye(matrix["n"])
    places = (matrix["row"], matrix["col"])
    return sparse.coo_array((matrix["data"], places), shape=matrix["shape"]).toarray()


def _stored(page: Page, console: Visit, files: list[Path]) -> Any:
    """Upload files and return what the service has stored then."""
    with page.expect_response(re.compile("/v1/systems$")) as answer:
        page.locator("#upload").set_input_files(files)
    assert answer.value.ok, answer.value.text()
    expect(page.locator("#structure")).to_contain_text(f"{N} degrees of freedom")
    return page.request.get(f"{console.url}/v1/systems/{answer.value.json()['id']}").json()


@pytest.mark.parametrize(
    "write",
    [
        _numpy,
        _compressed,
        _scipy,
        _coordinates,
        _text,
        _abaqus,
        _market,
        _beside_market,
        _nastran,
        _calculix,
    ],
)
def test_files_are_sent_as_they_are(
    console: Visit, tmp_path: Path, write: Callable[[Path], list[str]]
) -> None:
    page = console.open("modes")
    system = _stored(page, console, [tmp_path / name for name in write(tmp_path)])
    np.testing.assert_allclose(_dense(system["M"]), M, rtol=1e-7)
    np.testing.assert_allclose(_dense(system["K"]), K, rtol=1e-13)
    expect(page.locator("#message")).to_be_empty()


def test_the_order_of_files_is_any(console: Visit, tmp_path: Path) -> None:
    page = console.open("modes")
    for name, matrix in (("stiffness", K), ("mass", M)):
        scipy.io.mmwrite(tmp_path / f"{name}.mtx", sparse.coo_array(matrix))
    system = _stored(page, console, [tmp_path / "stiffness.mtx", tmp_path / "mass.mtx"])
    np.testing.assert_allclose(_dense(system["M"]), M, rtol=1e-15)
    np.testing.assert_allclose(_dense(system["K"]), K, rtol=0)


def test_lists_of_entries_are_placed_by_their_nodes(console: Visit, tmp_path: Path) -> None:
    """The mass leaves out the first node, which has none: its rows are not those of the file."""
    light = M.copy()
    light[0, 0] = 0.0
    for name, matrix in (("M", light), ("K", K)):
        entries = [(i, j, float(matrix[i, j])) for i in range(N) for j in range(i + 1)]
        lines = [f"{i + 1},2, {j + 1},2, {value!r}" for i, j, value in entries if value]
        (tmp_path / f"{name}.mtx").write_text("\n".join(lines))
    page = console.open("modes")
    system = _stored(page, console, [tmp_path / "M.mtx", tmp_path / "K.mtx"])
    np.testing.assert_allclose(_dense(system["M"]), light, rtol=0)


def test_one_table_alone_is_the_stiffness_of_unit_masses(console: Visit, tmp_path: Path) -> None:
    np.savetxt(tmp_path / "anything.csv", K, delimiter=",")
    page = console.open("modes")
    system = _stored(page, console, [tmp_path / "anything.csv"])
    np.testing.assert_allclose(_dense(system["M"]), np.eye(N), rtol=0)
    np.testing.assert_allclose(_dense(system["K"]), K, rtol=0)


def test_what_it_cannot_read_it_names_with_the_way_out(console: Visit, tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "wing.mat", {"M": M, "K": K})
    page = console.open("modes")
    page.locator("#upload").set_input_files(tmp_path / "wing.mat")
    expect(page.locator("#message")).to_contain_text("cannot read wing.mat")
    message = page.locator("#message").inner_text()
    # The way out is a way: the line of Python writes what can be uploaded.
    line = (
        message[message.index("import numpy") :]
        .replace('read_model("wing.mat")', f"read_model({str(tmp_path / 'wing.mat')!r})")
        .replace('"wing.npz"', repr(str(tmp_path / "wing.npz")))
    )
    exec(line)
    system = _stored(page, console, [tmp_path / "wing.npz"])
    np.testing.assert_allclose(_dense(system["M"]), M, rtol=1e-15)
    expect(page.locator("#message")).to_be_empty()


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("K.csv", "1, 2\n3\n", "K.csv: line 2: 1 number instead of 2"),
        ("K.csv", "1, x\n2, 3\n", "line 1: 'x' is not a number"),
        ("K.mtx", "1 1\n2 2\n", "line 1: 2 numbers; lists of entries have 3 or 5"),
        ("K.npz", "no archive", "K.npz: it is no archive of numpy"),
        ("K.mtx", "3 3 3\n1 1 2\n2 2 5\n2 1 1\n", "line 1: it can be an entry, or the size"),
        ("K.mtx", "1 1 0x10\n", "'0x10' is hexadecimal"),
        ("K.mtx", "1.5 1 2\n", "line 1: '1.5' is not a whole number"),
        ("K.csv", "1,5;2\n2;3\n", "line 1: '1,5' has a decimal comma"),
        ("K.csv", "1,,2\n2,1\n", "an empty field"),
        (
            "K.mtx",
            "%%MatrixMarket matrix coordinate real general\n1 1 1\n1 1 1,5\n",
            "line 3: '1,5' has a decimal comma",
        ),
        ("K.json", "{}", "M"),
    ],
)
def test_faults_of_files_are_named(
    console: Visit, tmp_path: Path, name: str, content: str, said: str
) -> None:
    (tmp_path / name).write_text(content)
    page = console.open("modes")
    page.locator("#upload").set_input_files(tmp_path / name)
    expect(page.locator("#message")).to_contain_text(said)


def test_names_that_do_not_tell_are_asked_for(console: Visit, tmp_path: Path) -> None:
    for name in ("one", "two"):
        np.savetxt(tmp_path / f"{name}.csv", K, delimiter=",")
    page = console.open("modes")
    page.locator("#upload").set_input_files([tmp_path / "one.csv", tmp_path / "two.csv"])
    expect(page.locator("#message")).to_contain_text(
        "one.csv: its name does not tell which matrix it is"
    )


def test_a_structure_comes_with_its_geometry(console: Visit, tmp_path: Path) -> None:
    nodes = [[0.2 * k, 0.0, 0.0] for k in range(N)]
    geometry = {"nodes": nodes, "dofs": [{"node": k, "direction": "z"} for k in range(N)]}
    document = {"M": M.tolist(), "K": K.tolist(), "geometry": geometry}
    (tmp_path / "frame.json").write_text(json.dumps(document))
    page = console.open("modes")
    _stored(page, console, [tmp_path / "frame.json"])
    expect(page.locator("#structure")).to_contain_text("frame.json")
    # The address holds the geometry: a colleague sees the same cloud of nodes.
    expect(page).to_have_url(re.compile("geometry"))


def _cantilever() -> dict[str, Any]:
    """Return a beam with L = 0.5, EI = 100, rhoA = 0.8, as an engineer has it."""
    elements, h, EI, rhoA = 8, 0.5 / 8, 100.0, 0.8
    bent = [[12, 6 * h, -12, 6 * h], [6 * h, 4 * h * h, -6 * h, 2 * h * h]]
    bent += [[-12, -6 * h, 12, -6 * h], [6 * h, 2 * h * h, -6 * h, 4 * h * h]]
    moved = [[156, 22 * h, 54, -13 * h], [22 * h, 4 * h * h, 13 * h, -3 * h * h]]
    moved += [[54, 13 * h, 156, -22 * h], [-13 * h, -3 * h * h, -22 * h, 4 * h * h]]
    whole = np.zeros((2, 2 * elements + 2, 2 * elements + 2))
    for e in range(elements):
        part = slice(2 * e, 2 * e + 4)
        whole[0, part, part] += rhoA * h / 420 * np.array(moved)
        whole[1, part, part] += EI / h**3 * np.array(bent)
    nodes = [[h * (e + 1), 0.0, 0.0] for e in range(elements)]
    dofs = [{"node": i // 2, "direction": ("y", "rz")[i % 2]} for i in range(2 * elements)]
    return {
        "M": whole[0, 2:, 2:].tolist(),
        "K": whole[1, 2:, 2:].tolist(),
        "geometry": {"nodes": nodes, "dofs": dofs},
    }


def test_a_beam_has_its_stop_at_the_tip_and_answers_with_units(
    console: Visit, tmp_path: Path
) -> None:
    (tmp_path / "beam.json").write_text(json.dumps(_cantilever()))
    page = console.open("modes")
    page.set_input_files("#upload", str(tmp_path / "beam.json"))
    expect(page.get_by_text("Stop 0 at coordinate 14 (node 8, y)")).to_be_visible()
    page.get_by_label("Units").select_option("m, kg, s")
    expect(page.get_by_label("Lower gap (m)")).to_have_value("0.004")
    expect(page.locator(".values").first).to_contain_text(re.compile(r"rad/s = \d+(\.\d+)? Hz"))
    expect(page.get_by_label("Units")).to_have_count(0)  # they are known now
    page.wait_for_timeout(500)  # until the address has it
    page.reload()
    expect(page.get_by_label("Ω from (rad/s)")).to_be_visible()
    expect(page.get_by_text("Stop 0 at coordinate 14 (node 8, y)")).to_be_visible()


def test_matrices_without_damping_are_said_to_have_none(console: Visit, tmp_path: Path) -> None:
    page = console.open("driven")
    page.set_input_files("#upload", [str(tmp_path / name) for name in _numpy(tmp_path)])
    expect(page.get_by_text("The structure has no damping")).to_be_visible()


def test_an_uploaded_structure_is_given_damping(console: Visit, tmp_path: Path) -> None:
    _market(tmp_path)
    page = console.open("driven")
    _stored(page, console, sorted(tmp_path.iterdir()))
    with page.expect_request(lambda each: '"damping"' in (each.post_data or "")) as asked:
        page.get_by_role("button", name="Give it 2 % damping").click()
    sent = json.loads(asked.value.post_data or "")["system"]
    assert sent["damping"] == {"ratio": 0.02}
    assert sent["id"].startswith("sys_")
    expect(page.get_by_label("Damping ratio ζ", exact=True)).to_have_value("0.02")
    expect(page.locator(".verdict")).to_contain_text("certified")


def test_files_are_dropped_and_what_is_not_used_is_said(console: Visit) -> None:
    text = program_files.op4_text({"MGG": M, "KGG": K, "PHG": K[:, :2].copy()})
    page = console.open("modes")
    with page.expect_response(re.compile("/v1/systems$")) as answer:
        page.evaluate(
            """text => {
                const data = new DataTransfer();
                data.items.add(new File([text], "model.op4"));
                const box = document.querySelector("p.upload");
                box.dispatchEvent(new DragEvent("drop", { dataTransfer: data, bubbles: true, cancelable: true }));
            }""",  # noqa: E501
            text,
        )
    assert answer.value.json()["unused"] == ["PHG"]
    expect(page.locator("#structure")).to_contain_text(f"{N} degrees of freedom")
    expect(page.locator("#message")).to_contain_text("Not used: PHG.")
