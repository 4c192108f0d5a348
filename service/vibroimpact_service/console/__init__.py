"""The console: static files, without references to other servers."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

MEDIA_TYPES: Final[Mapping[str, str]] = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}

POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Content-Security-Policy of the pages: no inline code, nothing from other servers."""

FILES: Final[Mapping[str, bytes]] = {
    path.name: path.read_bytes()
    for path in sorted(Path(__file__).parent.iterdir())
    if path.suffix in MEDIA_TYPES
}
"""File name -> content."""


def media_type(name: str) -> str:
    """Return the media type of a file by its name."""
    return MEDIA_TYPES[Path(name).suffix]
