"""The client library of the vibroimpact computation service."""

from typing import TYPE_CHECKING, Any

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
    MissingExtra,
    NeglectedWarning,
    NotFound,
    ServerError,
    StructureWarning,
    TooLarge,
    TooManyRequests,
    Unavailable,
    VibroimpactError,
)
from vibroimpact.functions import Function, function
from vibroimpact.jobs import AsyncJob, Job, Submitted
from vibroimpact.kinds import (
    Attractors,
    Branches,
    Calibration,
    Ensemble,
    ExistenceBands,
    ImpactModes,
    NaturalFrequencies,
    PeriodicMotions,
    Resonances,
    SlowFlow,
    Sweep,
    TimeHistory,
)
from vibroimpact.local import Local
from vibroimpact.plans import Plan
from vibroimpact.requests import (
    attractors_request,
    branches_request,
    calibration_request,
    ensemble_request,
    existence_bands_request,
    impact_modes_request,
    natural_frequencies_request,
    periodic_motions_request,
    resonances_request,
    slow_flow_request,
    sweep_request,
    time_history_request,
)
from vibroimpact.results import Result
from vibroimpact.systems import (
    absorber,
    base_motion,
    base_vibration,
    beam,
    bouncing_ball,
    chain,
    constraint,
    dashpot,
    double_pendulum,
    drive,
    harmonic,
    oscillator,
    sampled,
    soft,
    system,
    two_mass,
)

if TYPE_CHECKING:
    from vibroimpact.models import (
        Model,
        Nodes,
        Reduction,
        condense,
        read_model,
        read_nodes,
        reduce,
    )
    from vibroimpact.records import Record, read_record


def __getattr__(name: str) -> Any:
    """Load what needs scipy when it is first used."""
    if name not in (
        "Model",
        "Nodes",
        "Reduction",
        "condense",
        "read_model",
        "read_nodes",
        "reduce",
        "Record",
        "read_record",
    ):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from vibroimpact import models, records

    return getattr(records if name in ("Record", "read_record") else models, name)


def __dir__() -> list[str]:
    """Return what the package offers, that which needs scipy included."""
    return __all__


__all__ = [
    "AccessDenied",
    "AsyncClient",
    "AsyncJob",
    "Attractors",
    "Branches",
    "Calibration",
    "Client",
    "ConfigurationError",
    "ConnectionFailed",
    "EmbeddedServiceError",
    "Ensemble",
    "ExistenceBands",
    "Function",
    "ImpactModes",
    "InvalidRequest",
    "Job",
    "JobCancelled",
    "JobFailed",
    "JobTimeout",
    "Local",
    "MissingExtra",
    "Model",
    "NaturalFrequencies",
    "NeglectedWarning",
    "Nodes",
    "NotFound",
    "PeriodicMotions",
    "Plan",
    "Record",
    "Reduction",
    "Resonances",
    "Result",
    "ServerError",
    "SlowFlow",
    "StructureWarning",
    "Submitted",
    "Sweep",
    "TimeHistory",
    "TooLarge",
    "TooManyRequests",
    "Unavailable",
    "VibroimpactError",
    "absorber",
    "attractors_request",
    "base_motion",
    "base_vibration",
    "beam",
    "bouncing_ball",
    "branches_request",
    "calibration_request",
    "chain",
    "condense",
    "constraint",
    "dashpot",
    "double_pendulum",
    "drive",
    "ensemble_request",
    "existence_bands_request",
    "function",
    "harmonic",
    "impact_modes_request",
    "natural_frequencies_request",
    "oscillator",
    "periodic_motions_request",
    "read_model",
    "read_nodes",
    "read_record",
    "reduce",
    "resonances_request",
    "sampled",
    "slow_flow_request",
    "soft",
    "sweep_request",
    "system",
    "time_history_request",
    "two_mass",
]
