"""The client library of the vibroimpact computation service."""

from vibroimpact.client import Client, impact_modes_request
from vibroimpact.errors import (
    AccessDenied,
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
from vibroimpact.jobs import Job
from vibroimpact.results import Result
from vibroimpact.systems import (
    bouncing_ball,
    chain,
    constraint,
    double_pendulum,
    oscillator,
    system,
    two_mass,
)

__all__ = [
    "AccessDenied",
    "Client",
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
    "TooLarge",
    "TooManyRequests",
    "Unavailable",
    "VibroimpactError",
    "bouncing_ball",
    "chain",
    "constraint",
    "double_pendulum",
    "impact_modes_request",
    "oscillator",
    "system",
    "two_mass",
]
