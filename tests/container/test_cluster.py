"""docker/cluster/compose.yaml: certificates, scheduler, workers and two services, with PostgreSQL.

The containers run with what the file says; those which the network policies of docker/kubernetes
keep apart in both directions cannot reach one another here either.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from typing import Any

import httpx2
import psycopg
import pytest

from tests.container import compose
from tests.container.build import ROOT
from tests.container.containers import Container, Relay
from tests.container.network import Network

PASSWORD = "not-a-secret"
VARIABLES = {
    "PYTHON_IMAGE": "python@sha256:0",
    "POSTGRES_IMAGE": "postgres@sha256:0",
    "CADDY_IMAGE": "caddy@sha256:0",
    "POSTGRES_PASSWORD": PASSWORD,
}
SWEEP = {
    "system": {"preset": "chain", "n": 40, "constraints": [{"dof": 5, "gap": 0.2}]},
    "frequency": {"start": 0.6, "stop": 2.4, "num": 200_000},
    "outputs": ["impulse", "exists"],
}
"""A request that is cut into chunks."""


@pytest.fixture(scope="module")
def services() -> dict[str, dict[str, Any]]:
    document = compose.read(ROOT / "docker" / "cluster" / "compose.yaml", VARIABLES)
    services: dict[str, dict[str, Any]] = document["services"]
    return services


@pytest.fixture(scope="module")
def database(
    postgresql: Callable[[], str], network: Network, services: Mapping[str, Any]
) -> Iterator[None]:
    """Put a PostgreSQL with the user and the database of the file behind its name."""
    given = services["database"]["environment"]
    url = postgresql()
    with psycopg.connect(url, autocommit=True) as connection:
        user = given["POSTGRES_USER"]
        connection.execute(f"CREATE ROLE {user} LOGIN PASSWORD '{given['POSTGRES_PASSWORD']}'")
        connection.execute(f"CREATE DATABASE {given['POSTGRES_DB']} OWNER {user}")
        parts = connection.info
        relay = Relay((network.gateway, 5432), (parts.host, parts.port))
    network.names["database"] = network.gateway
    yield
    relay.close()


APART = [
    ("worker", "service"), ("worker", "other-service"), ("worker", "other-worker"),
    ("other-worker", "service"), ("other-worker", "other-service"),
    ("service", "other-service"), ("worker", "database"), ("other-worker", "database"),
    ("scheduler", "database"),
]  # fmt: skip
"""Containers between which no packet passes."""


@pytest.fixture(scope="module")
def cluster(
    started: Callable[..., Container],
    network: Network,
    services: Mapping[str, Mapping[str, Any]],
    database: None,
) -> dict[str, Container]:
    """Start all containers of the image in the order of the file, and wait until they are ready."""
    made = started(services["certificates"], "certificates")
    assert made.wait() == 0, made.output.read_text()
    there = {"scheduler": started(services["scheduler"], "scheduler")}
    there["worker"] = started(services["worker"], "worker")
    there["other worker"] = started(services["worker"], "other-worker")
    for name in ("service", "other service"):
        there[name] = started(services["service"], name.replace(" ", "-"))
    for pair in APART:
        network.forbid(*pair)
    for name in ("service", "other service"):
        container = there[name]
        container.until(lambda c=container: ready(c), "is not ready")
        print(f"{name}: ready after {time.monotonic() - container.began:.1f} s")
    return there


def ready(container: Container) -> bool:
    """Whether the port of the metrics, which needs no key, says that it is ready."""
    with suppress(httpx2.TransportError):
        answer = httpx2.get(f"http://{container.address}:8001/v1/health/ready", timeout=5)
        return answer.is_success and answer.json()["kernels"] == "warm"
    return False


@pytest.fixture(scope="module")
def key(
    cluster: dict[str, Container],
    started: Callable[..., Container],
    services: Mapping[str, Mapping[str, Any]],
) -> str:
    command = ["vibroimpact", "keys", "create", "ann"]
    container = started(services["service"], "keys", command=command)
    assert container.wait() == 0, container.output.read_text()
    return container.output.read_text().split()[-1]


def client(container: Container, key: str) -> httpx2.Client:
    return httpx2.Client(
        base_url=f"http://{container.address}:8000",
        headers={"Authorization": f"Bearer {key}"},
        timeout=60,
    )


def test_a_job_is_done_by_the_workers(cluster: dict[str, Container], key: str) -> None:
    """Submitted to one replica, read from the other one."""
    with client(cluster["service"], key) as one, client(cluster["other service"], key) as other:
        start = time.monotonic()
        answer = one.post("/v1/jobs", json={"kind": "impact-modes", "request": SWEEP})
        assert answer.status_code == 201, answer.text
        job = answer.json()["id"]
        end = start + 120
        while not (state := other.get(f"/v1/jobs/{job}", params={"wait": 20}).json())["final"]:
            assert time.monotonic() < end, state
        assert state["state"] == "succeeded", state
        print(f"a job of {SWEEP['frequency']['num']} frequencies: {time.monotonic() - start:.1f} s")
        result = other.get(f"/v1/jobs/{job}/result", headers={"Accept": "application/x-hdf5"})
        assert result.status_code == 200


@pytest.mark.parametrize(("source", "target"), APART)
def test_they_cannot_reach_one_another(
    cluster: dict[str, Container], network: Network, source: str, target: str
) -> None:
    """What the others did, they did without."""
    container = cluster[source.replace("-", " ")]
    for address, passes in ((network.names[target], False), (network.names["scheduler"], True)):
        code = f"import socket; socket.create_connection(('{address}', 8786), 5)"
        done = container.execute(["python", "-c", code])
        assert (done.returncode == 0) is passes, done.stderr
        assert ("No route to host" in done.stderr) is not passes


def test_only_those_with_a_certificate_are_answered(cluster: dict[str, Container]) -> None:
    with pytest.raises(httpx2.TransportError):
        httpx2.get(f"https://{cluster['scheduler'].address}:8786/", verify=False, timeout=5)


def test_the_health_check_is_of_the_service_alone(
    cluster: dict[str, Container], services: Mapping[str, Mapping[str, Any]]
) -> None:
    for name, container in cluster.items():
        _, *command = container.image.configuration["Healthcheck"]["Test"]
        passes = container.execute(command).returncode == 0
        disabled = services[name.split()[-1]]["healthcheck"].get("disable", False)
        assert passes is not disabled, name


def test_each_stays_within_its_limits(
    cluster: dict[str, Container], services: Mapping[str, Mapping[str, Any]]
) -> None:
    for name, container in cluster.items():
        limit = services[name.split()[-1]]["deploy"]["resources"]["limits"]["memory"]
        print(f"{name}: {container.limits.peak() / 2**20:.0f} MiB")
        assert container.limits.peak() < compose.number_of_bytes(limit) / 2


def test_all_end_in_time(cluster: dict[str, Container]) -> None:
    for name in ("other service", "service", "worker", "other worker", "scheduler"):
        code, seconds = cluster[name].stop()
        print(f"{name}: ended {seconds:.1f} s after SIGTERM, with {code}")
        assert code == 0
        assert seconds <= cluster[name].grace
