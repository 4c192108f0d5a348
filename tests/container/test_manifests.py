"""Compose files and Kubernetes objects, as kustomize renders them, by their published schemas."""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path
from typing import Any

import jsonschema
import kubernetes_validate
import pytest

from tests.container import compose
from tests.container.build import ROOT
from tests.container.kubectl import pods, rendered

VERSIONS = ("1.32", "1.37")
"""Oldest version of Kubernetes that has all that is used, and the newest with a schema."""
IMAGES = dict.fromkeys(("PYTHON_IMAGE", "POSTGRES_IMAGE", "CADDY_IMAGE"), "x@sha256:0")
COMPOSE = [ROOT / "docker" / name for name in ("compose.yaml", "cluster/compose.yaml")]


@pytest.fixture(scope="module")
def specification() -> Any:
    """Return the schema of the compose specification, which check-jsonschema ships."""
    vendored = resources.files("check_jsonschema.builtin_schemas") / "vendor"
    return json.loads((vendored / "compose-spec.json").read_text())


@pytest.mark.parametrize("path", COMPOSE, ids=lambda path: path.parent.name)
def test_compose_files_are_valid(path: Path, specification: Any) -> None:
    document = compose.read(path, IMAGES | {"POSTGRES_PASSWORD": "secret"})
    jsonschema.validate(document, specification)
    document["services"]["another"] = {"image": "x", "memory": "2g"}
    with pytest.raises(jsonschema.ValidationError, match="memory"):
        jsonschema.validate(document, specification)


def test_the_cluster_says_which_variable_is_missing() -> None:
    (path,) = (path for path in COMPOSE if path.parent.name == "cluster")
    with pytest.raises(KeyError, match=r"PYTHON_IMAGE|POSTGRES"):
        compose.read(path, {})


def test_the_service_alone_needs_no_variable() -> None:
    (path,) = (path for path in COMPOSE if path.parent.name != "cluster")
    (service,) = compose.read(path, {})["services"].values()
    assert service["build"]["args"]["PYTHON_IMAGE"].startswith("python:3")


@pytest.fixture(scope="module", params=["embedded", "cluster"])
def objects(request: pytest.FixtureRequest) -> list[dict[str, Any]]:
    return rendered(request.param)


@pytest.mark.parametrize("version", VERSIONS)
def test_objects_are_valid(objects: list[dict[str, Any]], version: str) -> None:
    for each in objects:
        kubernetes_validate.validate(each, version, strict=True)
    wrong = objects[0] | {"metadata": {"nmae": "x"}}
    with pytest.raises(kubernetes_validate.ValidationError):
        kubernetes_validate.validate(wrong, version, strict=True)


def test_pods_are_restricted(objects: list[dict[str, Any]]) -> None:
    """What the level `restricted` of the Pod Security Standards asks for, which is enforced."""
    namespace = next(each for each in objects if each["kind"] == "Namespace")
    assert namespace["metadata"]["labels"]["pod-security.kubernetes.io/enforce"] == "restricted"
    for pod in pods(objects).values():
        spec = pod["spec"]
        assert spec["automountServiceAccountToken"] is False
        assert spec["securityContext"]["runAsNonRoot"] is True
        assert spec["securityContext"]["runAsUser"] == 10001
        assert spec["securityContext"]["seccompProfile"] == {"type": "RuntimeDefault"}
        (container,) = spec["containers"]
        assert container["securityContext"] == {
            "allowPrivilegeEscalation": False,
            "readOnlyRootFilesystem": True,
            "capabilities": {"drop": ["ALL"]},
        }
        assert {"memory", "ephemeral-storage"} <= set(container["resources"]["limits"])
        assert {"cpu", "memory"} <= set(container["resources"]["requests"])
        mounts = {each["mountPath"] for each in container["volumeMounts"]}
        assert {"/data", "/tmp"} <= mounts
        assert {each["name"] for each in container["volumeMounts"]} == {
            each["name"] for each in spec["volumes"]
        }


def test_all_that_is_named_is_there(objects: list[dict[str, Any]]) -> None:
    """Selectors, targets of the scaling, claims and configuration, by their rendered names."""
    there = {(each["kind"], each["metadata"]["name"]) for each in objects}
    labels = {name: pod["metadata"]["labels"] for name, pod in pods(objects).items()}
    for each in objects:
        name, spec = each["metadata"]["name"], each.get("spec", {})
        if each["kind"] == "Service":
            assert labels[name] == spec["selector"]
        if each["kind"] == "PodDisruptionBudget":
            assert labels[name] == spec["selector"]["matchLabels"]
        if each["kind"] == "HorizontalPodAutoscaler":
            target = spec["scaleTargetRef"]
            assert (target["kind"], target["name"]) in there
            scaled = [e["spec"] for e in objects if e["kind"] == target["kind"]]
            scaled = [e for e in scaled if e["selector"]["matchLabels"]["part"] == target["name"]]
            assert "replicas" not in scaled[0]  # each apply would set them
        if each["kind"] != "Namespace":
            assert each["metadata"]["namespace"] == "vibroimpact"
    for pod in pods(objects).values():
        (container,) = pod["spec"]["containers"]
        assert container["image"].startswith("registry.example.org/vibroimpact:")
        for source in container["envFrom"]:
            if "configMapRef" in source:
                assert ("ConfigMap", source["configMapRef"]["name"]) in there
        for volume in pod["spec"]["volumes"]:
            claim = volume.get("persistentVolumeClaim")
            if claim is not None:
                assert ("PersistentVolumeClaim", claim["claimName"]) in there


def test_only_the_service_has_the_database() -> None:
    secrets = {
        name: {
            source["secretRef"]["name"]
            for source in pod["spec"]["containers"][0]["envFrom"]
            if "secretRef" in source
        }
        for name, pod in pods(rendered("cluster")).items()
    }
    assert secrets == {
        "service": {"vibroimpact-database", "vibroimpact-store"},
        "worker": {"vibroimpact-store"},
        "scheduler": set(),
    }


def test_one_service_keeps_its_data() -> None:
    (pod,) = pods(objects := rendered("embedded")).values()
    volumes = {each["name"]: each for each in pod["spec"]["volumes"]}
    assert volumes["data"] == {"name": "data", "persistentVolumeClaim": {"claimName": "data"}}
    (deployment,) = (each for each in objects if each["kind"] == "Deployment")
    assert deployment["spec"]["replicas"] == 1
    assert deployment["spec"]["strategy"] == {"type": "Recreate"}
