"""Settings of the service, from arguments and environment variables ``VIBROIMPACT_…``."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import Field, SecretStr, ValidationError, model_validator
from pydantic_settings import BaseSettings, SettingsConfigDict, SettingsError

from vibroimpact_service import addresses

_PREFIX: Final = "VIBROIMPACT_"
_OF_EXAMPLES: Final = ("NAME", "TLS")
"""Variables of the proxy and of the batch script that come with the service."""
_OF_OTHERS: Final = ("URL", "KEY", "PROFILE", "TIMEOUT", "TEST_")
"""Variables of clients and of tests, which a service may inherit."""
RENAMED: Final = {"driven_jobs": "running_jobs", "spot_seconds": "on_submission_seconds"}
"""Names of version 0.1.0 -> present names. The old ones are still read."""


class SettingsInvalidError(ValueError):
    """A setting has a value that is not valid."""


class Settings(BaseSettings):
    """Settings of one service process; the environment variable is VIBROIMPACT_ and the name."""

    model_config = SettingsConfigDict(env_prefix=_PREFIX, frozen=True, extra="ignore")

    host: str = Field("127.0.0.1", description="Address to listen on.")
    port: int = Field(8000, ge=0, le=65535, description="Port to listen on; 0 takes a free one.")
    metrics_port: int | None = Field(
        None,
        ge=0,
        le=65535,
        description="Port that serves only metrics and health, without keys; 0 takes a free one, "
        "unset: none.",
    )
    metrics_host: str = Field(
        "127.0.0.1", description="Address on which that port is; whoever reaches it may read them."
    )
    hosts: tuple[str, ...] = Field(
        (),
        description="Host names that the service answers to; unset: on a loopback address "
        "without keys only those of this machine, otherwise any.",
    )
    data: Path = Field(Path("vibroimpact-data"), description="Folder of the records and results.")
    database: str | None = Field(
        None, description="SQLAlchemy URL of the records; unset: SQLite in the data folder."
    )
    store: str | None = Field(None, description="fsspec URL of the store; unset: the data folder.")
    scheduler: str | None = Field(
        None, description="Address tls://… of a Dask scheduler; unset: own worker processes."
    )
    tls_ca: Path | None = Field(None, description="Certificate authority of that scheduler.")
    tls_cert: Path | None = Field(None, description="Certificate with which to connect to it.")
    tls_key: Path | None = Field(None, description="Private key of that certificate.")
    workers: int = Field(os.cpu_count() or 2, ge=1, description="Number of own worker processes.")
    worker_memory_bytes: int | None = Field(
        None,
        ge=2**29,
        description="Memory of one worker process, and of one of vi.Local, enforced by the "
        "operating system; unset: an equal share of 0.8 of the machine's, or the container's, for "
        "each worker, half of it at most and 1 GiB at least.",
    )
    structures_bytes: int = Field(
        2**28,
        ge=0,
        description="Memory of the structures of recent requests, with what was prepared for "
        "them, that each process keeps for the next request about one.",
    )
    grace_seconds: float = Field(
        10.0,
        ge=0,
        description="Time after which a cancelled computation that does not stop loses its worker.",
    )
    webhook_private: bool = Field(
        False, description="Whether webhooks may go to servers in private networks."
    )
    webhook_ca: Path | None = Field(
        None,
        description="Certificate authority accepted for webhook servers in addition to the "
        "usual ones.",
    )
    webhook_key: SecretStr | None = Field(
        None,
        min_length=16,
        description="Text from which the key is derived that encrypts the secrets of webhooks in "
        "the records, the same for all replicas; unset: TLS_KEY, or a file in the data folder.",
    )
    running_jobs: int = Field(16, ge=1, description="Jobs that run at the same time.")
    keep_jobs_days: float = Field(90.0, gt=0, description="Age at which finished jobs are removed.")
    keep_results_days: float = Field(
        365.0, gt=0, description="Age at which results that are not pinned are removed."
    )
    keep_chunks_days: float = Field(
        30.0, gt=0, description="Age at which chunks of results are removed."
    )
    max_store_bytes: int | None = Field(
        None, ge=0, description="Total size of the results above which the oldest are removed."
    )
    max_chunks_bytes: int | None = Field(
        None, ge=0, description="Total size of the chunks above which the oldest are removed."
    )
    clean_seconds: float = Field(3600.0, gt=0, description="Time between two clean-ups.")
    access: Literal["auto", "keys", "open"] = Field(
        "auto",
        description="Authentication. keys: a key or token is required. open: whoever "
        "reaches the port may compute, see and cancel everything. auto: "
        "required if there are keys or an issuer is set; otherwise a loopback "
        "address is open and any other address is refused.",
    )
    oidc_issuer: str | None = Field(
        None, description="Address of an OpenID Connect issuer whose tokens are accepted."
    )
    oidc_audience: str = Field("vibroimpact", description="Audience that its tokens must name.")
    oidc_scope_prefix: str = Field(
        "vibroimpact:", description="Prefix of read, submit, … among the scopes of a token."
    )
    requests_per_minute: int = Field(6000, ge=1, description="Rate limit of a key without its own.")
    seconds_per_hour: float = Field(
        36_000.0, gt=0, description="Quota of planned computing time of a key without its own."
    )
    max_job_seconds: float = Field(
        86_400.0, gt=0, description="Planned computing time above which a request is refused."
    )
    max_unfinished_jobs: int = Field(
        1000, ge=1, description="Unfinished jobs that one owner may have."
    )
    limits_storage: str = Field(
        "memory://",
        description="Where requests are counted; redis://… if replicas share the limits.",
    )
    cors_origins: tuple[str, ...] = Field(
        (), description='Origins of web pages that may read answers, as JSON: ["https://a.b"].'
    )
    max_body_bytes: int = Field(64 * 2**20, ge=1024, description="Largest request body.")
    max_bodies_bytes: int = Field(
        512 * 2**20, ge=2048, description="Total size of the request bodies in memory."
    )
    max_header_bytes: int = Field(
        32 * 2**10, ge=1024, description="Largest header section of a request."
    )
    max_connections: int = Field(2000, ge=1, description="Connections at the same time.")
    header_seconds: float = Field(
        10.0, gt=0, description="Time limit for receiving the header section."
    )
    body_seconds: float = Field(
        30.0, gt=0, description="Longest pause while a body is sent or an answer is read."
    )
    max_dofs: int = Field(
        5000, ge=1, description="Largest number of degrees of freedom of a system."
    )
    max_points: int = Field(
        10_000_000,
        ge=1,
        description="Largest number of frequencies, or of output times, of a request.",
    )
    max_sweep_points: int = Field(
        1_000_000, ge=1, description="Largest number of points of a sweep."
    )
    max_result_bytes: int = Field(2**30, ge=1024, description="Largest result.")
    plan_seconds: float = Field(
        0.25,
        gt=0,
        description="Processor time of a plan, beside that for its matrices, above which a "
        "request is refused.",
    )
    inline_seconds: float = Field(
        1.0,
        ge=0,
        description="Planned time above which a computation becomes a job instead of being "
        "answered directly.",
    )
    inline_overrun_seconds: float = Field(
        10.0,
        gt=0,
        description="Running time after which a computation that was to be answered "
        "directly becomes a job; INLINE_SECONDS of processor time where others wait for its "
        "thread.",
    )
    inline_memory_bytes: int = Field(
        2 * 2**30,
        ge=2**20,
        description="Resident memory of the service process above which computations in it are "
        "given up and become jobs.",
    )
    on_submission_seconds: float = Field(
        0.02, ge=0, description="Planned time below which a job is computed while it is submitted."
    )
    batch_requests: int = Field(1000, ge=1, description="Largest number of requests in a batch.")
    batch_seconds: float = Field(
        0.1, gt=0, description="Planned time above which a request may not be part of a batch."
    )
    inline_threads: int = Field(
        max(2, os.cpu_count() or 2),
        ge=1,
        description="Threads for checks and small computations; more threads than cores "
        "slow one another down.",
    )
    max_waiting: int = Field(
        256,
        ge=1,
        description="Requests that may wait for these threads; further ones are answered 503.",
    )
    max_waiting_seconds: float = Field(
        2.0,
        gt=0,
        description="Time that a request may wait for these threads; then it is answered 503, and "
        "so are new ones as long as one waits for that time.",
    )

    @model_validator(mode="before")
    @classmethod
    def _read_old_names(cls, given: dict[str, Any]) -> dict[str, Any]:
        """Take settings by their names of 0.1.0 where the present ones are not given."""
        values = dict(given)
        environment = {name.upper(): value for name, value in os.environ.items()}
        for old, new in RENAMED.items():
            value = values.pop(old, environment.get(_variable((old,))))
            if value is not None:
                message = f"{_variable((old,))} is now called {_variable((new,))}"
                warnings.warn(message, DeprecationWarning, stacklevel=2)
                values.setdefault(new, value)
        return values

    @property
    def database_url(self) -> str:
        """SQLAlchemy URL of the records."""
        return self.database or f"sqlite:///{(self.data / 'records.sqlite').absolute()}"

    @property
    def store_url(self) -> str:
        """URL, for fsspec, of requests, chunks and results."""
        return self.store or str((self.data / "store").absolute())


def read(**given: Any) -> Settings:
    """Return the settings of this process.

    Parameters
    ----------
    **given : Any
        Settings from arguments, which override the environment. None counts as not given.

    Raises
    ------
    SettingsInvalidError
        If a value is not valid; it names the variables.
    """
    try:
        settings = Settings(**{name: value for name, value in given.items() if value is not None})
    except ValidationError as error:
        raise invalid((_variable(fault["loc"]), fault["msg"]) for fault in error.errors()) from None
    except SettingsError as error:
        # Lists are the only values that are not plain text.
        raise SettingsInvalidError(f"{error}; lists are written as JSON") from None
    wrong = [(_variable((name,)), text) for name, text in addresses.faults(vars(settings))]
    if wrong:
        raise invalid(wrong)
    return settings


def check_certificates(settings: Settings) -> None:
    """Refuse settings with which no scheduler can be reached, nor run; as `read`."""
    files = {name: getattr(settings, name) for name in ("tls_ca", "tls_cert", "tls_key")}
    wrong = [(_variable((name,)), text) for name, text in addresses.certificates(files)]
    if wrong:
        raise invalid(wrong)


def check_listening(settings: Settings) -> None:
    """Refuse settings with which no service can listen; as `read`."""
    names = ["host"] if settings.metrics_port is None else ["host", "metrics_host"]
    for name in names:
        try:
            addresses.listening(getattr(settings, name))
        except addresses.AddressError as error:
            raise invalid([(_variable((name,)), str(error))]) from None


def invalid(faults: Iterable[tuple[str, str]]) -> SettingsInvalidError:
    """Return the error about variables, and what is wrong with each."""
    return SettingsInvalidError("; ".join(f"{name}: {text}" for name, text in faults))


def renamed(environment: Iterable[str]) -> dict[str, str]:
    """Return the variables with old names, and their present names."""
    given = {name.upper() for name in environment}
    names = {_variable((old,)): _variable((new,)) for old, new in RENAMED.items()}
    return {old: new for old, new in names.items() if old in given}


def unknown(environment: Iterable[str]) -> list[str]:
    """Return the variables VIBROIMPACT_… that name no setting, most likely misspelt."""
    named = (*Settings.model_fields, *RENAMED, *_OF_EXAMPLES)
    known = {f"{_PREFIX}{name}".upper() for name in named}
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
