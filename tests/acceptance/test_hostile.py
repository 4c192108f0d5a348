"""Bodies that are meant to hurt: answered with a 4xx within a second, in bounded memory.

The second is one of the processor: those of the clock are no fault of a body on a busy machine.
"""

from __future__ import annotations

import gzip
import io
import json
import os
import re
import time
import zipfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from tests.effort import least

JSON = "application/json"
MARKET = "application/x-matrix-market"
NPY = "application/x-npy"
FORM = "multipart/form-data; boundary=x"
MODES = "/v1/compute/impact-modes"
MIB = 2**20


def system(**fields: Any) -> dict[str, Any]:
    chain = {"preset": "chain", "n": 13, "constraints": [{"dof": 5, "gap": 0.2}]}
    return {**chain, **fields}


def modes(**fields: Any) -> str:
    return json.dumps({"system": system(), "frequency": {"values": [1.0]}, **fields})


def npy(descr: str, shape: str) -> bytes:
    text = f"{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode()


def zip_bomb() -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("M.npy", bytes(50 * MIB))
    return buffer.getvalue()


def market(sizes: str) -> str:
    return f"%%MatrixMarket matrix coordinate real general\n{sizes}\n1 1 1.0\n"


def form(*contents: bytes, name: str = "K.csv") -> bytes:
    """Return a body of parts with the boundary x."""
    head = f'--x\r\nContent-Disposition: form-data; name="file"; filename="{name}"\r\n\r\n'
    parts = (head.encode() + content + b"\r\n" for content in contents)
    return b"".join(parts) + b"--x--\r\n"


HOSTILE: dict[str, tuple[str, str, str | bytes]] = {
    "empty": (MODES, JSON, b""),
    "spaces": (MODES, JSON, b" " * MIB),
    "zeros": (MODES, JSON, bytes(MIB)),
    "not utf-8": (MODES, JSON, b'{"system": "\xff\xfe"}'),
    "byte order mark": (MODES, JSON, b"\xef\xbb\xbf{}"),
    "utf-16": (MODES, JSON, modes().encode("utf-16")),
    "lists in lists": (MODES, JSON, b"[" * 10**6),
    "lists in lists, closed": (MODES, JSON, b"[" * 10**6 + b"]" * 10**6),
    "objects in objects": (MODES, JSON, b'{"system":' * 10**5 + b"1" + b"}" * 10**5),
    "deep within the limit": (MODES, JSON, b'{"system":' + b"[" * 190 + b"]" * 190 + b"}"),
    "a name a million times": (MODES, JSON, b"{" + b'"a":1,' * 10**6 + b'"a":1}'),
    "a hundred thousand names": (
        MODES, JSON, b"{" + b",".join(b'"%d":1' % i for i in range(99_000)) + b"}",
    ),
    "a long name": (MODES, JSON, b'{"' + b"a" * 10 * MIB + b'":1}'),
    "lone surrogate as name": (MODES, JSON, rb'{"\ud800": 1}'),
    "lone surrogate as value": (MODES, JSON, modes(system={"preset": "\ud800"})),
    "lone surrogate as unit": (
        MODES, JSON, modes(frequency={"values": [1.0], "unit": "\udfff"}),
    ),
    "control characters": (MODES, JSON, modes(outputs=["\u0000\u0007\u202e"])),
    "a huge integer": (MODES, JSON, b'{"system": ' + b"9" * 4 * MIB + b"}"),
    "a huge integer as n": (MODES, JSON, modes(system=system(n=10**400))),
    "n of 2 to the 63": (MODES, JSON, modes(system=system(n=2**63))),
    "n of 10 to the 8": (MODES, JSON, modes(system=system(n=10**8))),
    "n with a fraction": (MODES, JSON, modes(system=system(n=13.5))),
    "n true": (MODES, JSON, modes(system=system(n=True))),
    "n as text": (MODES, JSON, modes(system=system(n="13"))),
    "10 to the 8 frequencies": (
        MODES, JSON, modes(frequency={"start": 1, "stop": 2, "num": 10**8}),
    ),
    "steps without end": (
        MODES, JSON, modes(frequency={"start": 1, "stop": 1e308, "step": 1e-308}),
    ),
    "step of zero": (MODES, JSON, modes(frequency={"start": 1, "stop": 2, "step": 0})),
    "step of -0.0": (MODES, JSON, modes(frequency={"start": 1, "stop": 2, "step": -0.0})),
    "frequency of -0.0": (MODES, JSON, modes(frequency={"values": [-0.0]})),
    "infinite number": (MODES, JSON, b'{"system": 1e400}'),
    "infinite frequency": (MODES, JSON, modes(frequency={"values": [1e308, 1e308]})[:-1] + "x"),
    "frequency of 1e400": (MODES, JSON, modes().replace("1.0]", "1e400]")),
    "nan": (MODES, JSON, modes(frequency={"values": [float("nan")]})),
    "infinity": (MODES, JSON, modes(frequency={"values": [float("-inf")]})),
    "mass of 1e308 at gap of 1e-308": (
        MODES, JSON, modes(system=system(mass=-1e308, stiffness=1e308)),
    ),
    "no frequencies": (MODES, JSON, modes(frequency={"values": []})),
    "a million tau": (MODES, JSON, modes(tau=[0.5] * 10**6, outputs=["waveform"], dofs=[99])),
    "a million wrong entries": (MODES, JSON, modes(frequency={"values": ["x"] * 90_000})),
    "a matrix of ragged rows": (
        MODES, JSON, modes(system={"M": [[1], [1, 2]], "K": [[1]], "constraints": []}),
    ),
    "coordinates of 10 to the 8": (
        MODES, JSON,
        modes(system={
            "M": {"shape": [10**8, 10**8], "row": [0], "col": [0], "data": [1]},
            "K": {"scalar": 1.0, "n": 10**8}, "constraints": [],
        }),
    ),
    "bands far out": (
        MODES, JSON,
        modes(system={"M": {"bands": {"99999999": [1]}}, "K": {"bands": {"0": [1]}},
                      "constraints": []}),
    ),
    "a hundred thousand constraints": (
        MODES, JSON, modes(system=system(constraints=[{"dof": 0, "gap": -1}] * 30_000)),
    ),
    "truncated": (MODES, JSON, modes()[:-20]),
    "hdf5": ("/v1/systems", "application/x-hdf5", b"\x89HDF\r\n\x1a\n" + bytes(1000)),
    "hdf5 as json": ("/v1/systems", JSON, b"\x89HDF\r\n\x1a\n" + bytes(1000)),
    "hdf5 as npy": ("/v1/systems", NPY, b"\x89HDF\r\n\x1a\n" + bytes(1000)),
    "zip bomb": ("/v1/systems", "application/zip", zip_bomb()),
    "npz as npy": ("/v1/systems", NPY, zip_bomb()),
    "npy of 8 TB": ("/v1/systems", NPY, npy("<f8", "(1000000, 1000000)") + bytes(1000)),
    "npy of 200 MB": ("/v1/systems", NPY, npy("<f8", "(5000, 5000)") + bytes(1000)),
    "npy of objects": ("/v1/systems", NPY, npy("|O", "(1, 1)") + b"cos\nsystem\n(S'true'\ntR."),
    "pickle": ("/v1/systems", NPY, b"\x80\x04\x95cos\nsystem\n(S'true'\ntR."),
    "market of 10 to the 8": ("/v1/systems", MARKET, market("100000000 100000000 100000000")),
    "market of many entries": ("/v1/systems", MARKET, market("5000 5000 25000000")),
    "market without end": ("/v1/systems", MARKET, "%%MatrixMarket " + "x" * 10 * MIB),
    "market of comments": ("/v1/systems", MARKET, market("%") + "%\n" * 10**6),
    "form without parts": ("/v1/systems", FORM, bytes(10 * MIB)),
    "form without end": ("/v1/systems", FORM, form(b"1" * 10 * MIB)[:-6]),
    "form of many parts": ("/v1/systems", FORM, form(*[b"1\n"] * 10**5)),
    "form of boundaries": ("/v1/systems", FORM, b"\r\n--x" * 10**6),
    "form of a gzip bomb": (
        "/v1/systems", FORM,
        form(gzip.compress(bytes(100 * MIB)), name="K.mtx.gz"),
    ),
    "form of a zip bomb": (
        "/v1/systems", FORM, form(zip_bomb(), name="K.npz"),
    ),
    "form of 10 to the 12 rows": (
        "/v1/systems", FORM,
        form(b"1 1 1.0\n1000000000000 1 1.0\n", name="K.sti"),
    ),
    "job of another kind": ("/v1/jobs", JSON, json.dumps({"kind": "x" * 1000, "request": {}})),
    "key of everything": ("/v1/keys", JSON, json.dumps({"owner": "\u202e" * 99})),
}  # fmt: skip


@pytest.fixture(scope="module")
def hardened(start: Callable[..., Any], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    service = start(tmp_path_factory.mktemp("hostile"))
    service.wait_ready()
    warm = service.http.post(MODES, content=modes(), headers={"Content-Type": JSON})
    assert warm.status_code == 200
    yield service
    service.stop()


def memory(service: Any) -> int:
    """Return the most mebibytes that the serving process ever had."""
    text = Path(f"/proc/{service.process.pid}/status").read_text()
    (peak,) = re.findall(r"^VmHWM:\s+(\d+) kB", text, re.M)
    return int(peak) // 1024


def used(service: Any) -> float:
    """Return the seconds of processor time that the serving process has used."""
    fields = Path(f"/proc/{service.process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def spent(service: Any, ask: Callable[[], Any], answers: list[Any]) -> float:
    """Return the processor time of a service from a request to its answer, which is kept.

    It does other work now and then.
    """
    before = used(service)
    answers.append(ask())
    return used(service) - before


def test_hostile_bodies(hardened: Any) -> None:
    before = memory(hardened)
    slow, wrong = {}, {}
    for name, (path, media_type, body) in HOSTILE.items():
        headers, answers = {"Content-Type": media_type}, list[Any]()
        ask = partial(hardened.http.post, path, content=body, headers=headers)
        seconds = least(partial(spent, hardened, ask, answers), 1.0)
        if seconds > 1.0:
            slow[name] = seconds
        answer = answers[-1]
        problem = answer.headers["content-type"] == "application/problem+json"
        if not (400 <= answer.status_code < 500 and problem and len(answer.content) < 10_000):
            wrong[name] = (answer.status_code, answer.text[:200])
    assert wrong == {}
    assert slow == {}
    assert memory(hardened) < before + 400


@pytest.mark.parametrize("coding", ["gzip", "deflate", "br", "zstd", "gzip, gzip", "x"])
def test_compressed_bodies_are_not_opened(hardened: Any, coding: str) -> None:
    bomb = gzip.compress(bytes(100 * MIB))
    headers = {"Content-Type": JSON, "Content-Encoding": coding}
    answer = hardened.http.post(MODES, content=bomb, headers=headers)
    assert answer.status_code == 415
    assert answer.headers["accept-encoding"] == "identity"


@pytest.mark.parametrize("claimed", [True, False])
def test_a_body_that_is_too_long_is_refused_before_it_is_whole(
    hardened: Any, claimed: bool
) -> None:
    before = memory(hardened)

    def pieces() -> Iterator[bytes]:
        for _ in range(100):
            yield b" " * MIB

    headers = {"Content-Type": JSON} | ({"Content-Length": str(100 * MIB)} if claimed else {})
    answer = hardened.http.post(MODES, content=pieces(), headers=headers)
    assert answer.status_code == 413
    assert answer.json()["errors"][0]["code"] == "body_too_long"
    assert memory(hardened) < before + 150


@pytest.mark.parametrize(
    "headers",
    [
        {"Content-Type": "application/json; charset=utf-7"},
        {"Content-Type": "text/plain"},
        {"Content-Type": JSON, "Idempotency-Key": "x" * 300},
        {"Content-Type": JSON, "Accept": "image/png"},
        {"Content-Type": JSON, "Host": "evil.example"},
    ],
)
def test_hostile_headers(hardened: Any, headers: dict[str, str]) -> None:
    answer = hardened.http.post(MODES, content=modes(), headers=headers)
    assert 400 <= answer.status_code < 500
    assert answer.headers["content-type"] == "application/problem+json"


ATTRACTORS = "/v1/compute/attractors"


def stiff(zeta: float) -> dict[str, Any]:
    """Return a small request whose plan is cheap, and whose computation is not."""
    wall = {"dof": 0, "gap": {"lower": None, "upper": 0}, "restitution": 0.8}
    structure = {"preset": "oscillator", "Omega0": 1, "zeta": zeta, "constraints": [wall]}
    return {
        "system": structure, "load": [{"dof": 0, "amplitude": 1}], "frequency": {"values": [2.6]},
        "initial": {"x": [[-2]], "v": [[1]]}, "settle": 200, "observe": 100,
    }  # fmt: skip


def test_motions_that_find_no_end_give_up_their_threads(
    start: Callable[..., Any], tmp_path: Path
) -> None:
    """Two of them hold all threads, become jobs and are cancelled; others are answered."""
    service = start(
        tmp_path, inline_threads="2", inline_overrun_seconds="1", max_waiting_seconds="20"
    )
    service.wait_ready()
    with ThreadPoolExecutor(2) as pool:
        asked = [partial(service.http.post, ATTRACTORS, json=stiff(zeta)) for zeta in (1e9, 2e9)]
        answers = list(pool.map(lambda ask: ask(), asked))
    assert [answer.status_code for answer in answers] == [202, 202]
    for number in range(4):
        given = json.loads(modes(frequency={"values": [1.1 + number]}))
        assert service.http.post(MODES, json=given).status_code == 200
    for answer in answers:
        job = answer.headers["location"]
        assert service.http.delete(job).is_success
        # By a worker, which looks at its signal as well.
        while (state := service.http.get(job).json()["state"]) in {"queued", "running"}:
            time.sleep(0.05)
        assert state == "cancelled"
    assert service.stop() == 0
