"""What can go wrong in the solvers, sorted by what the caller can do about it.

::

    SolverError
    ├── ModelError         the input is wrong: correct the field it names
    ├── PlanError          nothing available can do this: ask for less or otherwise
    ├── ConvergenceError   a numerical method gave up: loosen the tolerance or report it
    └── Cancelled          the caller asked to stop

A motion that does not exist is a result with a reason, never an exception.
"""

from __future__ import annotations


class SolverError(Exception):
    """Base of all errors that this package raises on purpose."""


class ModelError(SolverError):
    """The input is wrong.

    Parameters
    ----------
    pointer : tuple of str or int
        Path of the wrong field from the argument that was passed, such as
        ``("constraints", 0, "gap")`` of a system.
    message : str
        What is wrong and what would be right.
    code : str
        Short stable name of the fault, such as ``"not_symmetric"``.
    """

    def __init__(self, pointer: tuple[str | int, ...], message: str, *, code: str) -> None:
        super().__init__(message)
        self.pointer = pointer
        self.message = message
        self.code = code

    def under(self, *prefix: str | int) -> ModelError:
        """Return the same error with its pointer seen from a document that holds the argument."""
        return ModelError((*prefix, *self.pointer), self.message, code=self.code)

    def __str__(self) -> str:
        """Return the field and what is wrong with it."""
        where = ".".join(str(part) for part in self.pointer)
        return f"{where}: {self.message}" if where else self.message

    def __reduce__(self) -> tuple[object, ...]:
        """Survive the way through a process boundary."""
        return (_model_error, (self.pointer, self.message, self.code))


def _model_error(pointer: tuple[str | int, ...], message: str, code: str) -> ModelError:
    return ModelError(pointer, message, code=code)


class PlanError(SolverError):
    """Nothing that is available can do what was asked."""


class ConvergenceError(SolverError):
    """A numerical method did not reach its tolerance."""


class Cancelled(SolverError):  # noqa: N818 (it is not an error of anyone)
    """The caller asked the computation to stop."""
