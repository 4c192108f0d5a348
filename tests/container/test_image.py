"""The image and docker/compose.yaml: what is in it, and a service that answers every kind.

The containers run with what the compose file says: command, user, read-only file system, volumes,
no capabilities, memory, processes and cores.
"""

from __future__ import annotations

import os
import stat
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import httpx2
import pytest

from tests.container import compose
from tests.container.build import ROOT
from tests.container.containers import Container, Image
from vibroimpact_schema import examples
from vibroimpact_service.kinds import KINDS

READY_SECONDS = 20.0
"""The kernels are there: nothing is compiled, which would take minutes."""
MAX_BYTES = 1.1e9
VARIABLES = {"PYTHON_IMAGE": "python@sha256:0"}
EXAMPLES = [
    pytest.param(kind, name, id=f"{kind}.{name}")
    for kind in KINDS
    for name in examples.requests(kind)
]


def files(tree: Path) -> Iterator[tuple[Path, os.stat_result]]:
    for folder, _, names in os.walk(tree):
        for name in names:
            path = Path(folder, name)
            yield path, path.lstat()


def kernels(tree: Path) -> dict[str, bytes]:
    """Return the compiled kernels below a folder, by name."""
    (place,) = tree.glob("**/compiled-*")
    kept = (path for path in place.rglob("*") if path.suffix in {".nbi", ".nbc", ".warm"})
    return {str(path.relative_to(place)): path.read_bytes() for path in kept}


def test_the_size_is_as_stated(image: Image) -> None:
    size = sum(there.st_blocks * 512 for _, there in files(image.tree))
    print(f"size of the image: {size / 1e6:.0f} MB")
    assert size <= MAX_BYTES


def test_there_is_no_compiler(image: Image) -> None:
    names = {path.name for path, there in files(image.tree) if there.st_mode & 0o111}
    assert "tini" in names
    compilers = {"cc", "gcc", "g++", "c++", "clang", "tcc", "as", "ld", "make", "rustc", "go"}
    assert names & compilers == set()


def test_nothing_gives_rights_to_who_runs_it(image: Image) -> None:
    """No file belongs to its user, sets a user or group, has capabilities, or is for all."""
    user, _ = image.user
    assert user == 10001
    for path, there in files(image.tree):
        place = path.relative_to(image.tree)
        assert not there.st_mode & (stat.S_ISUID | stat.S_ISGID), place
        if stat.S_ISREG(there.st_mode):
            assert not there.st_mode & stat.S_IWOTH, place
            assert "security.capability" not in os.listxattr(path), place
        assert there.st_uid != user or place.parts[0] == "data", place


def test_the_kernels_are_for_the_architecture(image: Image) -> None:
    environment = dict(each.split("=", 1) for each in image.configuration["Env"])
    architecture = os.uname().machine
    expected = {"x86_64": "x86-64-v3", "aarch64": "generic"}
    assert environment["NUMBA_CPU_NAME"] == expected[architecture]


@pytest.fixture(scope="module")
def service() -> dict[str, Any]:
    document = compose.read(ROOT / "docker" / "compose.yaml", VARIABLES)
    service: dict[str, Any] = document["services"]["vibroimpact"]
    return service


@pytest.fixture(scope="module")
def key(started: Callable[..., Container], service: Mapping[str, Any]) -> str:
    command = ["vibroimpact", "keys", "create", "ann", "--data", "/data"]
    container = started(service, "keys", command=command)
    assert container.wait() == 0, container.output.read_text()
    (line,) = (word for word in container.output.read_text().split() if word.startswith("vi"))
    return line


@pytest.fixture(scope="module")
def running(started: Callable[..., Container], service: Mapping[str, Any], key: str) -> Container:
    """Return a container of the service, ready."""
    return until_ready(started(service, "vibroimpact"))


def health(container: Container) -> dict[str, Any]:
    with suppress(httpx2.TransportError):
        answer = httpx2.get(f"http://{container.address}:8000/v1/health/ready", timeout=5)
        if answer.is_success:
            answered: dict[str, Any] = answer.json()
            return answered
    return {}


def until_ready(container: Container) -> Container:
    state = container.until(lambda: health(container), "is not ready")
    seconds = time.monotonic() - container.began
    print(f"{container.name} is ready after {seconds:.1f} s")
    assert state["kernels"] == "warm"
    assert seconds <= READY_SECONDS
    return container


def ask(container: Container, key: str) -> httpx2.Client:
    return httpx2.Client(
        base_url=f"http://{container.address}:8000",
        headers={"Authorization": f"Bearer {key}"},
        timeout=120,
    )


def ended(client: httpx2.Client, job: str) -> dict[str, Any]:
    """Wait for the end of a job and return it."""
    end = time.monotonic() + 120
    while not (state := client.get(f"/v1/jobs/{job}", params={"wait": 20}).json())["final"]:
        assert time.monotonic() < end, state
    assert state["state"] == "succeeded", state
    document: dict[str, Any] = state
    return document


def test_it_runs_as_its_user_without_rights(running: Container) -> None:
    processes = running.processes()
    assert {"tini", "vibroimpact"} <= {entries["Name"] for entries in processes.values()}
    for entries in processes.values():
        assert entries["Uid"].split() == ["10001"] * 4
        assert int(entries["CapEff"], 16) == int(entries["CapBnd"], 16) == 0
        assert entries["NoNewPrivs"] == "1"


def test_the_health_check_passes(running: Container, image: Image) -> None:
    how, *command = image.configuration["Healthcheck"]["Test"]
    assert how == "CMD"
    done = running.execute(command)
    assert done.returncode == 0, done.stderr


def test_nothing_but_data_and_temporary_files_can_be_written(running: Container) -> None:
    lines = running.execute(["cat", "/proc/mounts"]).stdout.splitlines()
    written = {line.split()[1] for line in lines if line.split()[3].split(",")[0] == "rw"}
    of_the_engine = {place for place in written if place.startswith(("/proc", "/dev"))}
    assert written - of_the_engine - {"/etc/hosts"} == {"/data", "/tmp"}
    assert running.execute(["touch", "/opt/there"]).returncode != 0
    assert running.execute(["touch", "/etc/hosts"]).returncode != 0


@pytest.mark.parametrize(("kind", "name"), EXAMPLES)
def test_every_kind_is_answered(running: Container, key: str, kind: str, name: str) -> None:
    content = examples.requests(kind)[name]["request"]
    with ask(running, key) as client:
        start = time.monotonic()
        answer = client.post(f"/v1/compute/{kind}", json=content)
        if answer.status_code == 202:
            answer = client.get(f"/v1/jobs/{ended(client, answer.json()['id'])['id']}/result")
        seconds = time.monotonic() - start
        assert answer.status_code == 200, answer.text
        print(f"{kind}.{name}: {seconds:.3f} s")
        assert answer.json()["kind"] == kind


def test_nothing_was_compiled(running: Container, image: Image) -> None:
    """After all answers the kernels are those of the image, every byte."""
    assert kernels(running.volumes["/data"]) == kernels(image.tree / "opt")


def test_it_stays_within_its_limits(running: Container, service: Mapping[str, Any]) -> None:
    limits = service["deploy"]["resources"]["limits"]
    assert running.limits.peak() < compose.number_of_bytes(limits["memory"]) / 2
    print(f"most memory: {running.limits.peak() / 2**20:.0f} MiB")


def test_it_ends_in_time_while_it_streams_and_computes(running: Container, key: str) -> None:
    """SIGTERM with an open event stream and a running job; the job goes on at the next start."""
    content = {
        "system": {"preset": "chain", "n": 40, "constraints": [{"dof": 5, "gap": 0.2}]},
        "frequency": {"start": 0.6, "stop": 2.4, "num": 1_500_000},
        "outputs": ["impulse", "exists"],
    }
    with ask(running, key) as client:
        answer = client.post("/v1/jobs", json={"kind": "impact-modes", "request": content})
        assert answer.status_code == 201, answer.text
        job = answer.json()["id"]
        received: list[str] = []

        def follow() -> None:
            with (
                client.stream("GET", f"/v1/jobs/{job}/events") as stream,
                suppress(httpx2.TransportError),
            ):
                received.extend(stream.iter_lines())

        thread = threading.Thread(target=follow)
        thread.start()
        running.until(lambda: received, "no event")
        code, seconds = running.stop()
        thread.join(30)
        print(f"it ended {seconds:.1f} s after SIGTERM, with {code}")
        assert seconds <= running.grace
        assert code == 0


def test_it_starts_again_with_its_jobs(
    running: Container, started: Callable[..., Container], service: Mapping[str, Any], key: str
) -> None:
    again = until_ready(started(service, "again"))
    with ask(again, key) as client:
        (job,) = (each for each in client.get("/v1/jobs").json()["jobs"] if not each["final"])
        assert ended(client, job["id"])["attempts"] == 2
    code, seconds = again.stop()
    assert code == 0
    assert seconds <= again.grace
