"""Documents about API keys and administrative acts."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AwareDatetime, Field

from vibroimpact_schema.values import Count, Document, Positive

ScopeName = Literal["read", "submit", "metrics", "admin"]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._@-]{0,79}$")]
Label = Annotated[str, Field(max_length=80)]


class KeyRequest(Document):
    """Request of a new key."""

    owner: Name = Field(
        description="Owner of the jobs and results that it gives access to.", examples=["ann"]
    )
    label: Label = Field("", description="Purpose of the key.")
    scopes: Annotated[list[ScopeName], Field(min_length=1, max_length=4)] = Field(
        ["read", "submit"], description="What it permits."
    )
    requests_per_minute: Count | None = Field(None, description="Absent: by the settings.")
    seconds_per_hour: Positive | None = Field(
        None, description="Planned computing time; absent: by the settings."
    )
    days: Annotated[float, Field(strict=True, gt=0, le=36500)] | None = Field(
        None, description="Days after which it expires."
    )


class ApiKey(Document):
    """A key, without its secret."""

    id: str = Field(examples=["0123456789ab"])
    owner: str
    label: str
    scopes: list[str]
    requests_per_minute: int | None
    seconds_per_hour: float | None
    created: AwareDatetime
    expires: AwareDatetime | None
    revoked: AwareDatetime | None
    valid: bool = Field(description="Whether it is accepted now.")


class MadeKey(ApiKey):
    """A key that was just made."""

    key: str = Field(description="The key itself, shown this once.")


class KeyList(Document):
    """All keys, oldest first."""

    keys: list[ApiKey]


class Act(Document):
    """An administrative act."""

    time: AwareDatetime
    actor: str = Field(description="The key that did it, or the user of the command line.")
    act: str = Field(examples=["key created"])
    subject: str = Field(description="Object of the act.")
    about: str = Field(description="Details, as JSON.")


class ActList(Document):
    """A page of administrative acts, newest first."""

    acts: list[Act]
    next: str | None = Field(description="Cursor of the next page; null on the last one.")
