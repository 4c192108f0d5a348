"""Everything that can be set about the service, from arguments or ``VIBROIMPACT_…`` variables."""

from __future__ import annotations

import os
from pathlib import Path

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict


class Settings(BaseSettings):
    """Settings of one service process; the environment variable is VIBROIMPACT_ and the name."""

    model_config = SettingsConfigDict(env_prefix="VIBROIMPACT_", frozen=True, extra="ignore")

    host: str = Field("127.0.0.1", description="Address to listen on.")
    port: int = Field(8000, ge=0, le=65535, description="Port to listen on; 0 takes a free one.")
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
    clean_seconds: float = Field(3600.0, gt=0, description="Time between two cleanings.")
    max_body_bytes: int = Field(64 * 2**20, ge=1024, description="Largest request body.")
    max_dofs: int = Field(5000, ge=1, description="Most degrees of freedom of a system.")
    max_points: int = Field(10_000_000, ge=1, description="Most points of a grid.")
    max_result_bytes: int = Field(2**30, ge=1024, description="Largest result.")
    inline_seconds: float = Field(
        1.0, ge=0, description="Planned work above it becomes a job instead of being awaited."
    )
    inline_threads: int = Field(
        max(4, (os.cpu_count() or 2) + 2), ge=1, description="Threads for checks and small work."
    )

    @property
    def database_url(self) -> str:
        """Where the records are."""
        return self.database or f"sqlite:///{(self.data / 'records.sqlite').absolute()}"

    @property
    def store_url(self) -> str:
        """Where requests, chunks and results are."""
        return self.store or str((self.data / "store").absolute())
