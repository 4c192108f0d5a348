"""Bytes of a body to a checked document, or a problem that says what is wrong with it."""

from __future__ import annotations

import re
from typing import Any, Final, TypeVar

import jiter
from pydantic import BaseModel, TypeAdapter, ValidationError

from vibroimpact_service import problems, validation
from vibroimpact_service.problems import ProblemError

_MOST_STRINGS: Final = 100_000
"""Strings of a body; more only serve to make unknown fields expensive to report."""

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
