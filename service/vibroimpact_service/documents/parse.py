"""Bytes of a body to a checked document, or a problem that says what is wrong with it."""

from __future__ import annotations

import gc
import re
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final, TypeVar

import jiter
from pydantic import BaseModel, TypeAdapter, ValidationError

from vibroimpact_service import problems, validation
from vibroimpact_service.problems import ProblemError

_MOST_STRINGS: Final = 100_000
"""Strings of a body; more only serve to make unknown fields expensive to report."""

_LONGEST_PAUSE: Final = 10.0
"""Seconds after which nobody joins a pause of the collector, so that it ends however many bodies
come."""

_pausing = threading.Lock()
_pauses = 0
_paused_at = 0.0

Model = TypeVar("Model", bound=BaseModel)


def json(body: bytes) -> Any:
    """Return the JSON content of a body.

    NaN and infinite numbers pass here, so that the model can name the field they stand in.

    Raises
    ------
    ProblemError
        400 where it is not JSON, has a name twice in an object, or is nested too deeply.
    """
    if body.count(b'"') > 2 * _MOST_STRINGS:
        message = f"The body has more than {_MOST_STRINGS} strings."
        raise problems.too_large("", "too_many_names", message)
    try:
        return jiter.from_json(body, allow_inf_nan=True, catch_duplicate_keys=True)
    except ValueError as error:
        raise ProblemError(problems.MALFORMED, _reason(str(error))) from None


def _reason(message: str) -> str:
    """Return the parser's message without what it quotes of the input."""
    place = re.search(r" at line \d+ column \d+$", message)
    where = place.group() if place else ""
    if message.startswith("Detected duplicate key"):
        return f"A name stands twice in one object{where}."
    if message.startswith("recursion limit"):
        return f"The body is nested too deeply{where}."
    return f"{message.removesuffix(where)}{where}."


def document(model: type[Model] | TypeAdapter[Model], content: Any, *prefix: str) -> Model:
    """Return the content as a document of the model; `prefix` is the path to the content.

    Raises
    ------
    ProblemError
        422 with a JSON pointer to each faulty field.
    """
    try:
        if isinstance(model, TypeAdapter):
            return model.validate_python(content)
        return model.model_validate(content)
    except ValidationError as error:
        raise validation.problem_of(error, content, *prefix) from None


@contextmanager
def uncollected() -> Iterator[None]:
    """Collect no cyclic garbage until the end of the block, in any thread.

    The documents of a large body are millions of new objects without a cycle. Python looks at all
    of them again and again while they are made: for a million initial states it takes three
    quarters of the time. A plan has a tenth of a second of processor time, and the thread in which
    it runs may be the one that collects what all others left.
    """
    joined = _join()
    try:
        yield
    finally:
        if joined:
            _leave()


def _join() -> bool:
    """Begin a pause or join the present one; return whether that is so."""
    global _pauses, _paused_at
    with _pausing:
        now = time.monotonic()
        if _pauses == 0:
            if not gc.isenabled():
                return False
            _paused_at = now
            gc.disable()
        elif now - _paused_at > _LONGEST_PAUSE:
            return False
        _pauses += 1
        return True


def _leave() -> None:
    global _pauses
    with _pausing:
        _pauses -= 1
        if _pauses == 0:
            gc.enable()
