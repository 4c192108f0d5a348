"""Exit codes, and errors as one line on stderr."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

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
    NotFound,
    TooLarge,
    TooManyRequests,
    Unavailable,
    VibroimpactError,
)

FAILED, WRONG, NO_ANSWER, NO_ACCESS, NOT_YET = 1, 2, 3, 4, 5
CODES: Final = (
    "0 done, 1 the computation failed or was cancelled, 2 the call or the request is wrong, "
    "3 no answer from the service, 4 no access, 5 not finished in time, 130 interrupted"
)
_BY_ERROR: Final[tuple[tuple[tuple[type[Exception], ...], int], ...]] = (
    ((JobFailed, JobCancelled), FAILED),
    ((InvalidRequest, NotFound, TooLarge, MissingExtra, ValueError), WRONG),
    ((ConnectionFailed, EmbeddedServiceError, Unavailable), NO_ANSWER),
    ((AccessDenied, ConfigurationError), NO_ACCESS),
    ((JobTimeout, TooManyRequests), NOT_YET),
)


@contextmanager
def reported() -> Iterator[None]:
    """Turn errors of the client into a line on stderr and an exit code."""
    try:
        yield
    except KeyboardInterrupt:
        sys.exit(130)
    except (VibroimpactError, ValueError, OSError) as error:
        print(f"vibroimpact: {error}", file=sys.stderr)
        sys.exit(next((code for types, code in _BY_ERROR if isinstance(error, types)), FAILED))
