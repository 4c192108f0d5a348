"""Marks the tests of the cluster in network namespaces; they share what the fault tests have."""

from __future__ import annotations

import os
import random
import shutil
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

FAULTS = Path(__file__).parents[1] / "faults"
for folder in (FAULTS, Path(__file__).parent):
    sys.path.insert(0, str(folder))

NETWORK = "10.213.82"
"""The network of the cluster, of which this machine is a part for as long as the tests run."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.network)


@pytest.fixture(scope="session")
def moments() -> random.Random:
    """Return the source of random moments; VIBROIMPACT_SEED repeats a run."""
    seed = int(os.environ.get("VIBROIMPACT_SEED", "0")) or random.randrange(1, 10**9)
    print(f"VIBROIMPACT_SEED={seed}")
    return random.Random(seed)


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[object]:
    """Return a cluster that is ready; nothing of it is left behind."""
    from cluster import Cluster

    from tests.container.network import Network, remove

    lacking = [name for name in ("caddy", "ip", "setpriv") if shutil.which(name) is None]
    if lacking or os.geteuid() != 0:
        pytest.fail(f"this needs root and {lacking or 'nothing else'}: see CONTRIBUTING.md")
    remove("vinet")  # what a run left that was killed
    network = Network("vinet", NETWORK)
    try:
        with closing(Cluster(network, tmp_path_factory.mktemp("cluster"))) as made:
            made.begin()
            yield made
    finally:
        network.close()
