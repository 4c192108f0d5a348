"""Deprecated routes: a dependency that says so in their answers (RFC 9745, RFC 8594)."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from email.utils import format_datetime

from starlette.requests import Request


@dataclass(frozen=True)
class Deprecation:
    """Adds the deprecation headers; declared at a route as a dependency, with deprecated=True.

    Parameters
    ----------
    since : datetime
        From when the route should not be used any more, in UTC.
    about : str
        Address of a page that says what to use instead.
    sunset : datetime, optional
        When it will cease to answer, in UTC.
    """

    since: datetime
    about: str
    sunset: datetime | None = None

    async def __call__(self, request: Request) -> None:
        """Add the headers to the answer."""
        headers: dict[str, str] = request.state.more_headers
        headers["Deprecation"] = f"@{int(self.since.timestamp())}"
        headers["Link"] = f'<{self.about}>; rel="deprecation"'
        if self.sunset is not None:
            headers["Sunset"] = format_datetime(self.sunset, usegmt=True)
