"""Check of authentication: whether keys are needed, and whether there are any."""

from __future__ import annotations

from vibroimpact_service.access import authenticator
from vibroimpact_service.access.authenticator import ExposedError
from vibroimpact_service.jobs.database import RecordsUnavailableError
from vibroimpact_service.operations.checks.check import Check, failed, ok, warning
from vibroimpact_service.settings import Settings


def access(settings: Settings) -> Check:
    """Check whether requests need keys that nobody has."""
    name, make = "keys", "make one:  vibroimpact keys create OWNER"
    try:
        needed = authenticator.keys_needed(settings)
        lacking = needed and settings.oidc_issuer is None and not authenticator.any_keys(settings)
    except ExposedError:
        seen = f"{settings.host} can be reached from other machines, and there are none"
        return failed(name, seen, make)
    except RecordsUnavailableError:
        return warning(name, "not known without the database", "see there")
    if lacking:
        return failed(name, "they are required, and there are none", make)
    if needed:
        return ok(name, "required")
    if authenticator.loopback(settings.host):
        return ok(name, "not required: only this machine reaches the service")
    return warning(
        name, f"whoever reaches {settings.host} may do everything", "unset VIBROIMPACT_ACCESS"
    )
