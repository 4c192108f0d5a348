"""What handlers work with: the parts of one application."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field

from starlette.requests import Request

from vibroimpact_service.access.authenticator import Authenticator
from vibroimpact_service.access.budget import Budget
from vibroimpact_service.api.body_memory import BodyMemory
from vibroimpact_service.metrics import Metrics
from vibroimpact_service.settings import Settings
from vibroimpact_service.use_case.evaluation import Evaluation


@dataclass(frozen=True, slots=True)
class Services:
    """The parts of one application."""

    settings: Settings
    authenticator: Authenticator
    budget: Budget
    metrics: Metrics
    evaluation: Evaluation
    body_memory: BodyMemory
    drain: asyncio.Event = field(default_factory=asyncio.Event)
    """Set when the service is told to stop."""


def services(request: Request) -> Services:
    """Return the parts of the application that serves a request."""
    parts: Services = request.app.state.services
    return parts
