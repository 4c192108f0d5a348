"""Routes that are on their way out, and how their answers say so (RFC 9745, RFC 8594)."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from email.utils import format_datetime
from typing import Final


@dataclass(frozen=True, slots=True)
class Deprecation:
    """From when a route should not be used any more.

    Parameters
    ----------
    since : datetime
        In UTC.
    about : str
        Address of a page that says what to use instead.
    sunset : datetime, optional
        When it will stop to answer, in UTC.
    """

    since: datetime
    about: str
    sunset: datetime | None = None

    def headers(self) -> dict[str, str]:
        """Return the header fields of its answers."""
        found = {
            "Deprecation": f"@{int(self.since.timestamp())}",
            "Link": f'<{self.about}>; rel="deprecation"',
        }
        if self.sunset is not None:
            found["Sunset"] = format_datetime(self.sunset, usegmt=True)
        return found


DEPRECATED: Final[dict[tuple[str, str], Deprecation]] = {}
"""(method, path) -> its deprecation; version 1 has none yet."""
