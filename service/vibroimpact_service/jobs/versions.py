"""The versions of scheduler and workers of a cluster; by the public interface of Dask."""

from __future__ import annotations

import platform
from importlib.metadata import version
from typing import Any, Final, NamedTuple

import dask
from distributed import Client

from vibroimpact_service.jobs import certificates
from vibroimpact_service.settings import Settings

_PACKAGES: Final = ("vibroimpact", "distributed", "cloudpickle", "msgpack", "numpy")
"""What processes of a cluster must agree on."""
_QUESTIONS: Final[dict[str, tuple[Any, ...]]] = {
    "Python": (platform.python_version,),
    **{package: (version, package) for package in _PACKAGES},
}
"""Name -> function and its arguments. Processes of every version know these functions."""


class ClusterVersions(NamedTuple):
    """Versions as of `here`: of the scheduler, and of each worker by its address."""

    scheduler: dict[str, str]
    workers: dict[str, dict[str, str]]


def here() -> dict[str, str]:
    """Return the versions of Python and some packages in this process."""
    return {name: ask(*args) for name, (ask, *args) in _QUESTIONS.items()}


def of_cluster(settings: Settings, seconds: float = 10.0) -> ClusterVersions:
    """Ask the scheduler that settings name, and its workers.

    Raises
    ------
    Exception
        Of many kinds, where one does not answer.
    """
    tls = certificates.of_settings(settings)
    with (
        dask.config.set({"distributed.comm.timeouts.connect": f"{seconds}s"}),
        Client(settings.scheduler, security=tls, set_as_default=False, timeout=seconds) as client,
    ):
        scheduler = {n: client.run_on_scheduler(*call) for n, call in _QUESTIONS.items()}
        answers = {n: client.run(*call, on_error="return") for n, call in _QUESTIONS.items()}
    addresses = set().union(*answers.values())
    workers = {at: {n: str(by[at]) for n, by in answers.items() if at in by} for at in addresses}
    return ClusterVersions(scheduler, workers)
