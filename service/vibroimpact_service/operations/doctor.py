"""All checks of an installation, and how they are shown."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Sequence
from typing import Final

from vibroimpact_service.operations.checks import environment
from vibroimpact_service.operations.checks.access import access
from vibroimpact_service.operations.checks.certificates import certificates
from vibroimpact_service.operations.checks.check import Check, failed
from vibroimpact_service.operations.checks.database import database
from vibroimpact_service.operations.checks.storage import store
from vibroimpact_service.operations.checks.workers import workers
from vibroimpact_service.settings import Settings

_WIDTHS: Final = (7, 15)
"""Of the state and of the name of a check, in characters."""


def checks(settings: Settings) -> Iterator[Check]:
    """Yield the outcomes of all checks, each as soon as it is known."""
    groups: list[Callable[[], list[Check]]] = [
        lambda: environment.settings(os.environ),
        lambda: [environment.data_folder(settings.data)],
        lambda: database(settings.database_url),
        lambda: [access(settings)],
        lambda: store(settings),
        lambda: [environment.temporary_room(settings.max_result_bytes)],
        lambda: certificates(settings),
        lambda: workers(settings),
        lambda: [environment.kernels()],
    ]
    for group in groups:
        try:
            yield from group()
        except Exception as error:  # the other checks are wanted all the same
            yield failed("doctor", f"a check failed: {type(error).__name__}: {error}", "report it")


def lines(check: Check) -> str:
    """Return a check as one line or two."""
    state, name = (
        text.ljust(width) for text, width in zip((check.state, check.name), _WIDTHS, strict=True)
    )
    advice = f"\n{' ' * (sum(_WIDTHS) + 4)}→ {check.advice}" if check.advice else ""
    return f"{state}  {name}  {check.seen}{advice}"


def document(outcomes: Sequence[Check]) -> str:
    """Return checks as JSON."""
    content = [
        {"check": c.name, "state": c.state, "seen": c.seen, "advice": c.advice} for c in outcomes
    ]
    return json.dumps({"ok": not any_failed(outcomes), "checks": content}, indent=1)


def any_failed(outcomes: Sequence[Check]) -> bool:
    """Whether a check failed."""
    return any(check.state == "failed" for check in outcomes)
