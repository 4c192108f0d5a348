"""Everything that can be set about the service, from arguments or ``VIBROIMPACT_…`` variables."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import Field, ValidationError
from pydantic_settings import BaseSettings, SettingsConfigDict, SettingsError

_PREFIX: Final = "VIBROIMPACT_"
_OF_OTHERS: Final = ("URL", "KEY", "PROFILE", "TIMEOUT", "TEST_")
"""Variables of clients and of tests, which a service may inherit."""


class SettingsInvalidError(ValueError):
    """A setting has a value that it cannot have."""


class Settings(BaseSettings):
    """Settings of one service process; the environment variable is VIBROIMPACT_ and the name."""

    model_config = SettingsConfigDict(env_prefix=_PREFIX, frozen=True, extra="ignore")

    host: str = Field("127.0.0.1", description="Address to listen on.")
    port: int = Field(8000, ge=0, le=65535, description="Port to listen on; 0 takes a free one.")
    hosts: tuple[str, ...] = Field(
        (),
        description="Names in the header Host that are answered; absent: on a loopback address "
        "without keys only those of this machine, else any.",
    )
    data: Path = Field(Path("vibroimpact-data"), description="Folder for records and results.")
    database: str | None = Field(None, description="SQLAlchemy URL; absent: SQLite in the folder.")
    store: str | None = Field(None, description="fsspec URL of the store; absent: the folder.")
    scheduler: str | None = Field(
        None, description="Address tls://… of a Dask scheduler; absent: workers of its own."
    )
    tls_ca: Path | None = Field(None, description="Certificate authority of that scheduler.")
    tls_cert: Path | None = Field(None, description="Own certificate for it.")
    tls_key: Path | None = Field(None, description="Own key for it.")
    workers: int = Field(os.cpu_count() or 2, ge=1, description="Own worker processes.")
    grace_seconds: float = Field(
        10.0, ge=0, description="After it, a cancelled call that goes on loses its worker."
    )
    webhook_private: bool = Field(
        False, description="Whether messages may go to servers in private networks."
    )
    webhook_ca: Path | None = Field(
        None, description="Authority that their certificates are signed by, beside the usual ones."
    )
    driven_jobs: int = Field(16, ge=1, description="Jobs under way at once.")
    keep_jobs_days: float = Field(90.0, gt=0, description="Age at which ended jobs are removed.")
    keep_results_days: float = Field(
        365.0, gt=0, description="Age at which results are removed that nobody pinned."
    )
    keep_chunks_days: float = Field(
        30.0, gt=0, description="Age at which parts of results are removed."
    )
    max_store_bytes: int | None = Field(
        None, ge=0, description="Size of all results beyond which the oldest are removed."
    )
    max_chunks_bytes: int | None = Field(
        None, ge=0, description="Size of all parts of results beyond which the oldest are removed."
    )
    clean_seconds: float = Field(3600.0, gt=0, description="Time between two cleanings.")
    access: Literal["auto", "keys", "open"] = Field(
        "auto",
        description="Who may ask. keys: whoever has a key or token. open: anybody who reaches "
        "the port may compute, see and cancel everything. auto: keys where there are any or an "
        "issuer is set; without, a loopback address is open and any other one is refused.",
    )
    oidc_issuer: str | None = Field(
        None, description="Address of an OpenID Connect issuer whose tokens are accepted."
    )
    oidc_audience: str = Field("vibroimpact", description="Audience that its tokens must name.")
    oidc_scope_prefix: str = Field(
        "vibroimpact:", description="What precedes read, submit, … among the scopes of a token."
    )
    requests_per_minute: int = Field(
        6000, ge=1, description="Requests of a key that has no number of its own."
    )
    seconds_per_hour: float = Field(
        36_000.0, gt=0, description="Planned computing of a key that has no number of its own."
    )
    max_job_seconds: float = Field(
        86_400.0, gt=0, description="Planned computing above which a request is refused."
    )
    max_unfinished_jobs: int = Field(
        1000, ge=1, description="Unfinished jobs that one owner may have."
    )
    limits_storage: str = Field(
        "memory://", description="Where requests are counted; redis://… where replicas share."
    )
    cors_origins: tuple[str, ...] = Field(
        (), description='Origins of web pages that may read answers, as JSON: ["https://a.b"].'
    )
    max_body_bytes: int = Field(64 * 2**20, ge=1024, description="Largest request body.")
    max_bodies_bytes: int = Field(
        512 * 2**20, ge=2048, description="All request bodies in memory at once."
    )
    max_header_bytes: int = Field(32 * 2**10, ge=1024, description="Largest header section.")
    max_connections: int = Field(2000, ge=1, description="Connections at once.")
    header_seconds: float = Field(10.0, gt=0, description="Longest time a header may take.")
    body_seconds: float = Field(
        30.0, gt=0, description="Longest pause within a body, or within the reading of an answer."
    )
    max_dofs: int = Field(5000, ge=1, description="Most degrees of freedom of a system.")
    max_points: int = Field(10_000_000, ge=1, description="Most points of a grid.")
    max_sweep_points: int = Field(1_000_000, ge=1, description="Most points of a sweep.")
    max_result_bytes: int = Field(2**30, ge=1024, description="Largest result.")
    inline_seconds: float = Field(
        1.0, ge=0, description="Planned work above it becomes a job instead of being awaited."
    )
    inline_overrun_seconds: float = Field(
        10.0,
        gt=0,
        description="Time after which what was to be answered at once becomes a job.",
    )
    spot_seconds: float = Field(
        0.02,
        ge=0,
        description="Planned work of a job below it is done while the job is submitted.",
    )
    batch_requests: int = Field(1000, ge=1, description="Most requests of one batch.")
    batch_seconds: float = Field(
        0.1, gt=0, description="Planned work up to which a request may be part of a batch."
    )
    inline_threads: int = Field(
        max(2, os.cpu_count() or 2),
        ge=1,
        description="Threads for checks and small work; more only keep one another waiting.",
    )
    max_waiting: int = Field(
        256, ge=1, description="Requests that wait for these threads; more are answered 503."
    )

    @property
    def database_url(self) -> str:
        """Where the records are."""
        return self.database or f"sqlite:///{(self.data / 'records.sqlite').absolute()}"

    @property
    def store_url(self) -> str:
        """Where requests, chunks and results are."""
        return self.store or str((self.data / "store").absolute())


def read(**given: Any) -> Settings:
    """Return the settings of this process.

    Parameters
    ----------
    **given : Any
        What arguments say; they win over the environment. None counts as not given.

    Raises
    ------
    SettingsInvalidError
        Where a value cannot be; it names the variables.
    """
    try:
        return Settings(**{name: value for name, value in given.items() if value is not None})
    except ValidationError as error:
        faults = [f"{_variable(fault['loc'])}: {fault['msg']}" for fault in error.errors()]
        raise SettingsInvalidError("; ".join(faults)) from None
    except SettingsError as error:
        # Lists are the only values that are not plain text.
        raise SettingsInvalidError(f"{error}; lists are written as JSON") from None


def unknown(environment: Iterable[str]) -> list[str]:
    """Return those variables VIBROIMPACT_… that no setting goes by, most likely misspelt."""
    known = {f"{_PREFIX}{name}".upper() for name in Settings.model_fields}
    others = tuple(_PREFIX + name for name in _OF_OTHERS)
    return sorted(
        name
        for name in environment
        if name.upper().startswith(_PREFIX)
        and name.upper() not in known
        and not name.upper().startswith(others)
    )


def _variable(place: tuple[int | str, ...]) -> str:
    return _PREFIX + str(place[0]).upper() if place else _PREFIX + "…"
