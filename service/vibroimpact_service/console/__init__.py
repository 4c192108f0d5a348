"""The console: static files, without references to other servers."""

from __future__ import annotations

import re
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

_FOLDER: Final = Path(__file__).parent
_JSDOC: Final = re.compile(rb"/\*\*.*?\*/", re.DOTALL)
_LINES: Final = re.compile(rb"^[ \t]*//.*$", re.MULTILINE)


def without_comments(module: bytes) -> bytes:
    """Return a module without its JSDoc and its lines of comments; lines keep their numbers."""
    without = _JSDOC.sub(lambda comment: b"\n" * comment[0].count(b"\n"), module)
    return _LINES.sub(b"", without)


def _files() -> dict[str, bytes]:
    files = {
        path.relative_to(_FOLDER).as_posix(): path.read_bytes()
        for path in sorted(_FOLDER.rglob("*"))
        if path.suffix in MEDIA_TYPES
    }
    # Types and explanations are a quarter of what the modules would weigh.
    files = {
        name: without_comments(content)
        if name.endswith(".js") and not name.startswith("vendor/")
        else content
        for name, content in files.items()
    }
    # Browsers would learn of each module from the one that imports it, one after the other.
    preload = "\n".join(
        f'<link rel="modulepreload" href="/console/{name}">'
        for name in files
        if name.endswith(".js") and not name.startswith(("vendor/", "docs", "notebook"))
    )
    files["index.html"] = files["index.html"].replace(b"<!-- modules -->", preload.encode())
    return files


FILES: Final[Mapping[str, bytes]] = _files()
"""File name -> content."""


def media_type(name: str) -> str:
    """Return the media type of a file by its name."""
    return MEDIA_TYPES[Path(name).suffix]
