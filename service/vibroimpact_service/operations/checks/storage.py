"""Checks of the store: whether it gives back what it takes, and how much room it has."""

from __future__ import annotations

import secrets
import shutil
import time
from pathlib import Path

from vibroimpact_service.operations.checks.check import Check, failed, ok, warning
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store, StoreFullError, StoreUnavailableError

_GB = 1e9


def store(settings: Settings) -> list[Check]:
    """Check the store, and leave it as it is."""
    url = settings.store_url
    if settings.store is None and not Path(url).exists():
        return [ok("store", f"{url} does not exist yet; the service makes it")]
    try:
        area = Store(url).results
    except (ImportError, ValueError) as error:
        return [failed("store", f"{url}: {error}", "correct VIBROIMPACT_STORE")]
    name, block = f"probe_{secrets.token_hex(8)}", secrets.token_bytes(1000)
    began = time.perf_counter()
    try:
        area.put(name, block)
        there = area.get(name)
        area.remove(name)
    except StoreFullError as error:
        return [failed("store", f"{url}: {error.strerror}", "make room")]
    except StoreUnavailableError as error:
        advice = "make it reachable, and writable for the service's user"
        return [failed("store", f"{url}: {error.strerror}", advice)]
    if there != block:
        return [failed("store", f"{url} does not give back what it takes", "check its disk")]
    seconds = time.perf_counter() - began
    seen = f"{url} takes, gives and removes a block in {1e3 * seconds:.1f} ms"
    return [ok("store", seen), *(_room(settings) if area.local else [])]


def _room(settings: Settings) -> list[Check]:
    free = shutil.disk_usage(settings.store_url).free
    seen = f"{free / _GB:.1f} GB free"
    if free < settings.max_result_bytes:
        needed = f"{settings.max_result_bytes / _GB:.1f} GB"
        return [warning("room", seen, f"less than one result may need, {needed}: make room")]
    if settings.max_store_bytes is not None:
        used = sum(entry.size for entry in Store(settings.store_url).results.entries())
        seen = f"{used / _GB:.1f} GB of {settings.max_store_bytes / _GB:.1f} GB used, {seen}"
        if used + free < settings.max_store_bytes:
            return [
                warning(
                    "room", seen, "the disk is full before MAX_STORE_BYTES is reached: lower it"
                )
            ]
    return [ok("room", seen)]
