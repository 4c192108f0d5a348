"""The client library of the vibroimpact computation service."""

from vibroimpact.async_client import AsyncClient
from vibroimpact.client import Client
from vibroimpact.errors import (
    AccessDenied,
    ConfigurationError,
    ConnectionFailed,
    EmbeddedServiceError,
    InvalidRequest,
    JobCancelled,
    JobFailed,
    JobTimeout,
    NotFound,
    ServerError,
    TooLarge,
    TooManyRequests,
    Unavailable,
    VibroimpactError,
)
from vibroimpact.jobs import AsyncJob, Job, Submitted
from vibroimpact.requests import (
    ensemble_request,
    existence_bands_request,
    impact_modes_request,
    resonances_request,
    slow_flow_request,
    time_history_request,
)
from vibroimpact.results import Result
from vibroimpact.sweeps import sweep_request
from vibroimpact.systems import (
    bouncing_ball,
    chain,
    constraint,
    double_pendulum,
    harmonic,
    oscillator,
    soft,
    system,
    two_mass,
)

__all__ = [
    "AccessDenied",
    "AsyncClient",
    "AsyncJob",
    "Client",
    "ConfigurationError",
    "ConnectionFailed",
    "EmbeddedServiceError",
    "InvalidRequest",
    "Job",
    "JobCancelled",
    "JobFailed",
    "JobTimeout",
    "NotFound",
    "Result",
    "ServerError",
    "Submitted",
    "TooLarge",
    "TooManyRequests",
    "Unavailable",
    "VibroimpactError",
    "bouncing_ball",
    "chain",
    "constraint",
    "double_pendulum",
    "ensemble_request",
    "existence_bands_request",
    "harmonic",
    "impact_modes_request",
    "oscillator",
    "resonances_request",
    "slow_flow_request",
    "soft",
    "sweep_request",
    "system",
    "time_history_request",
    "two_mass",
]
