"""The NetworkPolicies of docker/kubernetes, evaluated: who may talk to whom, and who may not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.service.policies import Peer, permitted

KUBERNETES = Path(__file__).parents[2] / "docker" / "kubernetes"
OURS = "vibroimpact"


def policies(*files: str) -> list[dict[str, Any]]:
    """Return the policies of some files, in the namespace that kustomize gives them."""
    there = []
    for file in files:
        for each in yaml.safe_load_all((KUBERNETES / file).read_text()):
            if each["kind"] == "NetworkPolicy":
                there.append(each | {"metadata": each["metadata"] | {"namespace": OURS}})
    return there


def ports(file: str) -> dict[str, int]:
    """Return the ports, by name, of the container in the deployment of a file."""
    deployment = next(yaml.safe_load_all((KUBERNETES / file).read_text()))
    (container,) = deployment["spec"]["template"]["spec"]["containers"]
    return {each["name"]: each["containerPort"] for each in container.get("ports", ())}


def part(name: str, address: str, file: str) -> Peer:
    return Peer(address, OURS, {"app": "vibroimpact", "part": name}, ports(file))


PEERS = {
    "service": part("service", "10.244.0.2", "base/service.yaml"),
    "other service": part("service", "10.244.0.3", "base/service.yaml"),
    "scheduler": part("scheduler", "10.244.0.4", "overlays/cluster/scheduler.yaml"),
    "worker": part("worker", "10.244.0.5", "overlays/cluster/worker.yaml"),
    "other worker": part("worker", "10.244.0.6", "overlays/cluster/worker.yaml"),
    "stranger": Peer("10.244.0.7", OURS, {"app": "other"}),
    "ingress": Peer("10.244.1.10", "ingress-nginx", {"app.kubernetes.io/name": "ingress-nginx"}),
    "prometheus": Peer("10.244.2.2", "monitoring", {"app.kubernetes.io/name": "prometheus"}),
    "other pod": Peer("10.244.3.2", "default", {"app": "vibroimpact", "part": "service"}),
    "database": Peer("10.244.4.2", "database", {"app": "postgresql"}),
    "other database": Peer("10.244.4.3", "database", {"app": "mysql"}),
    "names": Peer("10.244.5.2", "kube-system", {"k8s-app": "kube-dns"}),
    "store": Peer("198.51.100.7"),
    "store (IPv6)": Peer("2001:db8::7"),
    "metadata of the cloud": Peer("169.254.169.254"),
    "machine of the company": Peer("10.1.2.3"),
}
ANY = (22, 80, 443, 5432, 8000, 8001, 8786, 40_123)
"""Ports among which the table says what is open; 40123 is one that a worker has chosen."""

ONE = {
    (source.format(who), target.format(who)): numbers
    for who in ("service", "other service")
    for (source, target), numbers in {
        ("ingress", "{}"): {8000},
        ("prometheus", "{}"): {8001},
        ("{}", "store"): {443},
        ("{}", "store (IPv6)"): {443},
    }.items()
}
"""Source, target -> open ports, with the policies of one service; all other pairs: none."""
CLUSTER = ONE | {
    ("service", "database"): {5432},
    ("service", "scheduler"): {8786},
    ("other service", "database"): {5432},
    ("other service", "scheduler"): {8786},
    ("worker", "scheduler"): {8786},
    ("other worker", "scheduler"): {8786},
    ("scheduler", "worker"): {5432, 8000, 8001, 8786, 40_123},  # at whichever port it listens
    ("scheduler", "other worker"): {5432, 8000, 8001, 8786, 40_123},
    ("worker", "store"): {443},
    ("worker", "store (IPv6)"): {443},
    ("other worker", "store"): {443},
    ("other worker", "store (IPv6)"): {443},
}
FILES = {
    "embedded": (ONE, ("base/network.yaml",), ("service",)),
    "cluster": (
        CLUSTER,
        ("base/network.yaml", "overlays/cluster/network.yaml"),
        ("service", "scheduler", "worker"),
    ),
}


@pytest.mark.parametrize("name", FILES)
def test_who_may_talk_to_whom(name: str) -> None:
    table, files, parts = FILES[name]
    there = policies(*files)
    ours = {
        who
        for who, peer in PEERS.items()
        if peer.namespace == OURS and peer.labels.get("part") in parts
    }
    wrong = []
    for source in PEERS:
        for target in PEERS:
            if source == target or not {source, target} & ours:
                continue
            open_ports = {
                port for port in ANY if permitted(there, PEERS[source], PEERS[target], port, "TCP")
            }
            if open_ports != table.get((source, target), set()):
                wrong.append((source, target, open_ports))
    assert wrong == []


@pytest.mark.parametrize("name", FILES)
def test_names_can_be_asked(name: str) -> None:
    there = policies(*FILES[name][1])
    for part in FILES[name][2]:
        for protocol in ("UDP", "TCP"):
            assert permitted(there, PEERS[part], PEERS["names"], 53, protocol)
        assert not permitted(there, PEERS[part], PEERS["store"], 53, "UDP")


def test_without_policies_all_is_open() -> None:
    """The evaluation can say both."""
    assert permitted([], PEERS["ingress"], PEERS["worker"], 40_123, "TCP")


def test_the_table_is_of_these_policies() -> None:
    """Without any one of them, something else is permitted than the table says."""
    whole = policies(*FILES["cluster"][1])
    for left_out in whole:
        rest = [each for each in whole if each is not left_out]
        changed = [
            (source, target)
            for source in PEERS
            for target in PEERS
            for port in (53, *ANY)
            if permitted(rest, PEERS[source], PEERS[target], port, "TCP")
            != permitted(whole, PEERS[source], PEERS[target], port, "TCP")
        ]
        assert changed, left_out["metadata"]["name"]
