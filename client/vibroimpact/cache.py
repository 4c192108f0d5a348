"""Results kept on disk by their digest, so that they are fetched once and read without a service.

Use it with ``Client(cache="~/.cache/vibroimpact")``. Nothing is removed; delete the folder at will.
"""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vibroimpact.result_file import opened


@dataclass(frozen=True, slots=True)
class Known:
    """What is known of a request: the digest of its result, and the version that was sent."""

    digest: str
    etag: str | None


class Cache:
    """A folder of results; several processes can share it."""

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder).expanduser()
        self.folder.mkdir(parents=True, exist_ok=True)

    def result(self, digest: str) -> bytes | None:
        """Return the file of a result, None if it is not here."""
        try:
            return self._file(digest).read_bytes()
        except FileNotFoundError:
            return None

    def keep(self, content: bytes) -> str:
        """Store the file of a result; return its digest."""
        with opened(content) as file:
            digest = str(file.attrs["digest"])
        _write(self._file(digest), content)
        return digest

    def known(self, kind: str, request: Mapping[str, Any]) -> Known | None:
        """Return what is known of a request, None if its result is not here."""
        try:
            known = Known(**json.loads(self._request(kind, request).read_text()))
        except (OSError, ValueError, TypeError):
            return None
        return known if self._file(known.digest).is_file() else None

    def learn(self, kind: str, request: Mapping[str, Any], digest: str, etag: str | None) -> None:
        """Note that a request has the result with a digest."""
        text = json.dumps({"digest": digest, "etag": etag})
        _write(self._request(kind, request), text.encode())

    def _file(self, digest: str) -> Path:
        return self.folder / f"{digest}.h5"

    def _request(self, kind: str, request: Mapping[str, Any]) -> Path:
        text = json.dumps([kind, request], sort_keys=True)
        return self.folder / f"request-{hashlib.sha256(text.encode()).hexdigest()}.json"


def _write(path: Path, content: bytes) -> None:
    """Write a file that is whole whenever it is there."""
    handle, name = tempfile.mkstemp(dir=path.parent)
    with os.fdopen(handle, "wb") as file:
        file.write(content)
    Path(name).replace(path)
