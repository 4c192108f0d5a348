"""What is slow to load and wanted at once: the numerical part of the service."""

from __future__ import annotations

import importlib
from typing import Final

NUMERICAL: Final = (
    "vibroimpact_service.chunks",
    "vibroimpact_service.batches",
    "vibroimpact_service.documents.decode",
    "vibroimpact_service.results.encode",
)
"""Modules that workers are born with."""


def load() -> None:
    """Import the modules into this process, where no request has to wait for it."""
    for module in NUMERICAL:
        importlib.import_module(module)
