"""Units of time that service and client convert frequencies by."""

from __future__ import annotations

from typing import Final

SECONDS: Final = {
    "ns": 1e-9,
    "us": 1e-6,
    "µs": 1e-6,
    "ms": 1e-3,
    "s": 1.0,
    "min": 60.0,
    "h": 3.6e3,
}
"""Seconds in each unit of time."""
