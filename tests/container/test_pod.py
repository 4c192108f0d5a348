"""The pod of docker/kubernetes/overlays/embedded, run on a volume as Kubernetes prepares one.

Such a volume belongs to root, and may be written by the group `fsGroup`, in which the processes
are.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import httpx2
import pytest

from tests.container.containers import Container
from tests.container.kubectl import pods, rendered


def as_service(volume: Path) -> dict[str, Any]:
    """Return what the overlay says of its container in the words of a compose file."""
    objects = rendered("embedded")
    spec = pods(objects)["service"]["spec"]
    (container,) = spec["containers"]
    (configuration,) = (each["data"] for each in objects if each["kind"] == "ConfigMap")
    limit = container["resources"]["limits"]["memory"]
    assert limit.endswith("Gi")
    rights = container["securityContext"]
    sources = {each["name"]: each for each in spec["volumes"]}
    mounts = {each["mountPath"]: sources[each["name"]] for each in container["volumeMounts"]}
    assert "persistentVolumeClaim" in mounts.pop("/data")
    assert all("emptyDir" in source for source in mounts.values())
    return {
        "command": container["args"],
        "environment": configuration,
        "read_only": rights["readOnlyRootFilesystem"],
        "cap_drop": rights["capabilities"]["drop"],
        "security_opt": [f"no-new-privileges:{not rights['allowPrivilegeEscalation']}".lower()],
        "deploy": {"resources": {"limits": {"memory": f"{limit[:-2]}g", "pids": 1024}}},
        "stop_grace_period": f"{spec['terminationGracePeriodSeconds']}s",
        "tmpfs": [f"{place}:mode=1777" for place in mounts],
        "volumes": [f"{volume.name}:/data"],
    }


def probe(container: Container, spec: dict[str, Any]) -> bool:
    """Ask what a probe asks, at the address of the pod."""
    ports = {each["name"]: each["containerPort"] for each in spec["ports"]}
    asked = spec["readinessProbe"]["httpGet"]
    address = f"http://{container.address}:{ports[asked['port']]}{asked['path']}"
    with suppress(httpx2.TransportError):
        return httpx2.get(address, timeout=spec["readinessProbe"]["timeoutSeconds"]).is_success
    return False


@pytest.fixture
def volume(tmp_path: Path) -> Path:
    spec = pods(rendered("embedded"))["service"]["spec"]
    folder = tmp_path / "data"
    folder.mkdir()
    os.chown(folder, 0, spec["securityContext"]["fsGroup"])
    folder.chmod(0o2775)
    return folder


def test_the_pod_is_ready_and_keeps_its_data(
    started: Callable[..., Container], volume: Path
) -> None:
    spec = pods(rendered("embedded"))["service"]["spec"]
    service = as_service(volume)
    more = {"group": spec["securityContext"]["fsGroup"], "volumes": {"data": volume}}
    command = ["vibroimpact", "keys", "create", "ann"]  # as the overlay says, without a folder
    keys = started(service, "pod-keys", command=command, **more)
    assert keys.wait() == 0, keys.output.read_text()
    key = keys.output.read_text().split()[-1]
    pod = started(service, "pod", **more)
    (container,) = spec["containers"]
    pod.until(lambda: probe(pod, container), "is not ready")
    answer = httpx2.get(
        f"http://{pod.address}:8000/v1/jobs", headers={"Authorization": f"Bearer {key}"}
    )
    assert answer.status_code == 200, answer.text
    folder = volume / Path(pod.environment["VIBROIMPACT_DATA"]).relative_to("/data")
    assert {"records.sqlite"} <= {path.name for path in folder.iterdir()}
    assert folder.stat().st_mode & 0o777 == 0o700
    code, seconds = pod.stop()
    assert code == 0
    assert seconds <= pod.grace
