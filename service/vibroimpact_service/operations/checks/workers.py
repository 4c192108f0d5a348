"""Checks of a scheduler and of its workers."""

from __future__ import annotations

from vibroimpact_service.jobs import versions
from vibroimpact_service.operations.checks.check import Check, failed, ok
from vibroimpact_service.settings import Settings


def workers(settings: Settings) -> list[Check]:
    """Check the scheduler that settings name, its workers and their versions."""
    if settings.scheduler is None:
        return []
    address = settings.scheduler
    if not address.startswith("tls://"):
        return [failed("scheduler", f"{address} is no address tls://…", "correct it")]
    try:
        there = versions.of_cluster(settings)
    except Exception as error:  # of whatever kind: Dask says it in many ways
        reason = (str(error).splitlines() or [""])[0]
        seen = f"{address}: {type(error).__name__}: {reason}"
        return [failed("scheduler", seen, "start it, with the same certificates")]
    own = versions.here()
    checks = [_same("scheduler", address, there.scheduler, own)]
    if not there.workers:
        return [*checks, failed("workers", "there are none", f"vibroimpact worker {address}")]
    others = {at: each for at, each in there.workers.items() if each != own}
    seen = f"{len(there.workers)}, of the same version"
    checks += [_same("worker", at, each, own) for at, each in sorted(others.items())]
    return checks if others else [*checks, ok("workers", seen)]


def _same(name: str, address: str, there: dict[str, str], own: dict[str, str]) -> Check:
    differences = [f"{part} {there.get(part)} instead of {own[part]}"
                   for part in own if there.get(part) != own[part]]  # fmt: skip
    if differences:
        advice = "install the same version on all machines"
        return failed(name, f"{address}: {', '.join(differences)}", advice)
    return ok(name, f"{address}, of the same version")
