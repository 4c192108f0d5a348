"""Errors of the solvers, by what the caller can do about them.

::

    SolverError
    ├── ModelError         invalid input: correct the field that it names
    ├── PlanError          no available method: request less, or something else
    ├── ConvergenceError   a numerical method failed: loosen the tolerance or report it
    └── Cancelled          the caller stopped the computation

A motion that does not exist is a result with a reason, not an exception.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from functools import partial
from typing import Any, Final


class SolverError(Exception):
    """Base class of all errors that this package raises deliberately."""


class ModelError(SolverError):
    """Invalid input.

    Parameters
    ----------
    pointer : tuple of str or int
        Path of the invalid field, from the argument that was passed, such as
        ``("constraints", 0, "gap")`` of a system.
    message : str
        What is wrong and what would be valid.
    code : str
        Short stable name of the error, such as ``"not_symmetric"``.
    """

    def __init__(self, pointer: tuple[str | int, ...], message: str, *, code: str) -> None:
        super().__init__(message)
        self.pointer = pointer
        self.message = message
        self.code = code

    def under(self, *prefix: str | int) -> ModelError:
        """Return the same error, its pointer relative to a document that contains the argument."""
        return ModelError((*prefix, *self.pointer), self.message, code=self.code)

    def __str__(self) -> str:
        """Return the field and the message."""
        where = ".".join(str(part) for part in self.pointer)
        return f"{where}: {self.message}" if where else self.message

    def __reduce__(self) -> tuple[object, ...]:
        """Support pickling, for other processes."""
        return (partial(ModelError, self.pointer, self.message, code=self.code), ())


class PlanError(SolverError):
    """No available method can do what is requested.

    Parameters
    ----------
    message : str
        The obstacle, and what would be possible.
    pointer : tuple of str or int
        Path of the field to change, as of a `ModelError`; empty where it is not one.
    """

    def __init__(self, message: str, pointer: tuple[str | int, ...] = ()) -> None:
        super().__init__(message)
        self.message = message
        self.pointer = pointer

    def under(self, *prefix: str | int) -> PlanError:
        """Return the same error, as of a `ModelError`."""
        return PlanError(self.message, (*prefix, *self.pointer) if self.pointer else ())

    def __reduce__(self) -> tuple[object, ...]:
        """Support pickling, for other processes."""
        return (PlanError, (self.message, self.pointer))


class ConvergenceError(SolverError):
    """A numerical method did not reach its tolerance."""


class Cancelled(SolverError):  # noqa: N818 (not an error)
    """The caller stopped the computation."""


def attempt(work: Callable[..., Any], *args: Any) -> Any:
    """Return the value of a function, or the error that it raises; `Cancelled` passes."""
    try:
        return work(*args)
    except Cancelled:
        raise
    except SolverError as error:
        return error


class Status(IntEnum):
    """Whether there is a result, of one problem of many, and why not."""

    OK = 0
    INVALID = 1
    NOT_POSSIBLE = 2
    NO_CONVERGENCE = 3

    @classmethod
    def of(cls, error: SolverError) -> Status:
        """Return the status that an error stands for."""
        match error:
            case ModelError():
                return cls.INVALID
            case PlanError():
                return cls.NOT_POSSIBLE
            case ConvergenceError():
                return cls.NO_CONVERGENCE
            case _:
                raise error


STATUSES: Final = tuple(status.name.lower() for status in Status)
