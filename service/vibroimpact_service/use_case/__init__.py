"""The use case: a request is answered from the store, computed now, or becomes a job of chunks.

`evaluation` decides which; `threads` compute each result once at a time in this process, `chunks`
are what workers do of a job; `computation` is what both have in common.
"""

from __future__ import annotations

import importlib
from typing import Final

NUMERICAL: Final = (
    "vibroimpact_service.use_case.chunks",
    "vibroimpact_service.use_case.batches",
    "vibroimpact_service.documents.decode",
    "vibroimpact_service.results.encode",
)
"""Modules that are slow to load and wanted at once: workers are born with them."""


def load() -> None:
    """Import these modules into this process, where no request has to wait for it."""
    for module in NUMERICAL:
        importlib.import_module(module)
