"""The image as `nox -s image` has built it, and containers that end with their tests."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.container.build import IMAGE, Storage, missing
from tests.container.containers import Container, Image
from tests.container.network import Network

IMAGES = "VIBROIMPACT_IMAGES"
"""Variable that names the folder of `python -m tests.container.build`."""


@pytest.fixture(scope="session")
def image() -> Image:
    """Return the built image, as a file system and its configuration."""
    lacking = missing()
    if lacking is not None:
        pytest.fail(f"containers cannot be run without {lacking}")
    storage = Storage(Path(os.environ[IMAGES]))
    return Image(storage.tree(), storage.inspect(IMAGE))


@pytest.fixture(scope="module")
def network() -> Iterator[Network]:
    # The network of docker/cluster, with one word of it changed: it may be there as well.
    network = Network("vibrotest", "172.30.82")
    yield network
    network.close()


@pytest.fixture(scope="module")
def started(
    image: Image, network: Network, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Callable[..., Container]]:
    """Return the function that starts a container of a service of a compose file."""
    folder = tmp_path_factory.mktemp("containers")
    volumes = {name: folder / "volumes" / name for name in ("data", "store", "tls")}
    containers: list[Container] = []

    def start(service: dict[str, Any], name: str, **more: Any) -> Container:
        more = {"volumes": volumes} | more
        containers.append(Container(image, service, network, name, folder, **more))
        return containers[-1]

    yield start
    for container in reversed(containers):
        container.close()
