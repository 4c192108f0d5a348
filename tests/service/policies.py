"""Who may talk to whom by the NetworkPolicies of Kubernetes, evaluated as its documentation says.

A pod that no policy selects for a direction is open in it; else at least one rule of those that
select it must permit the connection. Both ends must permit it.
"""

from __future__ import annotations

import ipaddress
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

NAME = "kubernetes.io/metadata.name"
"""Label that Kubernetes gives every namespace: its name."""


class Peer(NamedTuple):
    """A pod, or something outside, which has no labels."""

    address: str
    namespace: str = ""
    labels: Mapping[str, str] = {}
    ports: Mapping[str, int] = {}


def permitted(
    policies: Sequence[Mapping[str, Any]], source: Peer, target: Peer, port: int, protocol: str
) -> bool:
    """Whether a connection from `source` to a port of `target` is permitted."""
    return all(
        _open(policies, direction, here, there, target, port, protocol)
        for direction, here, there in (("egress", source, target), ("ingress", target, source))
    )


def _open(
    policies: Sequence[Mapping[str, Any]],
    direction: str,
    here: Peer,
    there: Peer,
    target: Peer,
    port: int,
    protocol: str,
) -> bool:
    selecting = [
        policy["spec"]
        for policy in policies
        if direction.capitalize() in policy["spec"]["policyTypes"]
        and here.namespace == policy["metadata"]["namespace"]
        and _selects(policy["spec"]["podSelector"], here.labels)
    ]
    if not selecting:
        return True
    end = {"egress": "to", "ingress": "from"}[direction]
    return any(
        _names(rule.get(end), there, here.namespace)
        and _has_port(rule.get("ports"), target, port, protocol)
        for spec in selecting
        for rule in spec.get(direction, ())
    )


def _names(peers: Sequence[Mapping[str, Any]] | None, other: Peer, namespace: str) -> bool:
    """Whether one of the peers of a rule is `other`; without peers, everyone is."""
    return not peers or any(_is(peer, other, namespace) for peer in peers)


def _is(peer: Mapping[str, Any], other: Peer, namespace: str) -> bool:
    assert set(peer) <= {"podSelector", "namespaceSelector", "ipBlock"}
    if "ipBlock" in peer:
        address = ipaddress.ip_address(other.address)
        block = peer["ipBlock"]
        inside = [address in ipaddress.ip_network(each) for each in block.get("except", ())]
        return address in ipaddress.ip_network(block["cidr"]) and not any(inside)
    if not other.namespace:
        return False
    if "namespaceSelector" in peer:
        there = _selects(peer["namespaceSelector"], {NAME: other.namespace})
    else:
        there = other.namespace == namespace
    return there and _selects(peer.get("podSelector", {}), other.labels)


def _selects(selector: Mapping[str, Any], labels: Mapping[str, str]) -> bool:
    assert set(selector) <= {"matchLabels", "matchExpressions"}
    for expression in selector.get("matchExpressions", ()):
        assert expression["operator"] == "In"
        if labels.get(expression["key"]) not in expression["values"]:
            return False
    return selector.get("matchLabels", {}).items() <= labels.items()


def _has_port(
    ports: Sequence[Mapping[str, Any]] | None, target: Peer, port: int, protocol: str
) -> bool:
    """Whether a rule is for a port; without ports, it is for all."""
    if not ports:
        return True
    for each in ports:
        assert set(each) <= {"port", "endPort", "protocol"}
        first = each["port"]
        number = target.ports.get(first) if isinstance(first, str) else first
        if number is None or protocol != each.get("protocol", "TCP"):
            continue
        if number <= port <= each.get("endPort", number):
            return True
    return False
