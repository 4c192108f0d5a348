"""What is slow to load and wanted at once: the numerical part of the service."""

from __future__ import annotations

from typing import Final

NUMERICAL: Final = (
    "vibroimpact_service.tasks",
    "vibroimpact_service.batches",
    "vibroimpact_service.decode",
    "vibroimpact_service.encode",
)
"""Modules that workers are born with."""
