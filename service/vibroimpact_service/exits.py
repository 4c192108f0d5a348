"""How commands end where something is wrong around them: one line, and an exit code.

2 is for settings and arguments, 3 for what cannot be reached or used at the moment, 1 for the rest.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final, NoReturn

import typer

from vibroimpact_service.settings import Settings, SettingsInvalidError, read

REFUSED: Final = 1
INVALID: Final = 2
UNAVAILABLE: Final = 3


def settings(**given: Any) -> Settings:
    """Return the settings of a command; end the process where one is not valid.

    Parameters
    ----------
    **given : Any
        Those from arguments; None counts as not given.
    """
    try:
        return read(**given)
    except SettingsInvalidError as error:
        invalid(error)


def invalid(error: SettingsInvalidError) -> NoReturn:
    """End the process because of a setting."""
    end(f"Invalid setting {error}", INVALID)


def end(message: str, code: int) -> NoReturn:
    """End the process with a message."""
    typer.echo(message, err=True)
    raise typer.Exit(code) from None


@contextmanager
def reported(*refused: type[Exception], where: str = "") -> Iterator[None]:
    """End the process with a line, not a traceback, for what can go wrong around a command.

    Parameters
    ----------
    *refused : type
        Exceptions whose message tells the operator enough.
    where : str
        Begin of the line.
    """
    from vibroimpact_service.jobs.database import RecordsUnavailableError
    from vibroimpact_service.jobs.revisions import RecordsNewerError

    plain: tuple[type[Exception], ...] = (RecordsNewerError, *refused)
    try:
        yield
    except SettingsInvalidError as error:
        invalid(error)
    except plain as error:
        end(f"{where}{error}", REFUSED)
    except RecordsUnavailableError as error:
        # What SQLAlchemy says has lines about itself, and the statement.
        reason = str(getattr(error.__cause__, "orig", None) or error.__cause__ or "").strip()
        end(f"{where}{error}: {reason.partition(chr(10))[0]}".removesuffix(": "), UNAVAILABLE)
    except OSError as error:  # those of the store among them
        file = f"{error.filename}: " if error.filename else ""
        end(f"{where}{file}{error.strerror or error}", UNAVAILABLE)
