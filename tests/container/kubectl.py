"""Overlays of docker/kubernetes as kubectl renders them, which asks no cluster for that."""

from __future__ import annotations

import shutil
import subprocess
from typing import Any

import pytest
import yaml

from tests.container.build import ROOT

OVERLAYS = ROOT / "docker" / "kubernetes" / "overlays"


def rendered(overlay: str) -> list[dict[str, Any]]:
    """Return the objects of an overlay."""
    kubectl = shutil.which("kubectl")
    if kubectl is None:
        pytest.fail("kubectl is not installed (see CONTRIBUTING.md)")
    command = [kubectl, "kustomize", str(OVERLAYS / overlay)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""  # deprecations
    return list(yaml.safe_load_all(done.stdout))


def pods(objects: list[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return the templates of pods by the names of their deployments."""
    return {
        each["metadata"]["name"]: each["spec"]["template"]
        for each in objects
        if each["kind"] == "Deployment"
    }
