"""Branches: the number of a request that varies, and the problems for its values."""

from __future__ import annotations

from vibroimpact_schema.branches import BranchesRequest
from vibroimpact_service.documents import decode, varying
from vibroimpact_service.kinds import KINDS
from vibroimpact_solvers import branches, periodic_motions, sweep
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.model import System


def problem(request: BranchesRequest, system: System) -> branches.Problem:
    """Return the problem of branches, whose points may have structures of their own.

    Raises
    ------
    ModelError
        With a pointer to the path that is wrong, or into the base.
    """
    kind, base = KINDS["periodic-motions"], request.base
    number = varying.number(base, request.path)
    if number.whole:
        message = f"{request.path} is a whole number, along which there is no branch"
        raise ModelError(("path",), message, code="not_a_number")

    def at(value: float) -> periodic_motions.Problem:
        try:
            number.fits(base, value)
            changed = number.put(base, value)
            own = number.path[0] == "system"
            made: periodic_motions.Problem = decode.problem(
                kind, changed, decode.system(changed.system) if own else system
            )
        except ModelError as error:
            raise error.under("base") from None
        return made

    unit, called = sweep.meaning(number.path)
    return branches.Problem(
        at,
        request.start,
        request.stop,
        system,
        number.path[0] == "frequency",
        request.switch,
        frozenset(request.stop_at),
        request.points,
        request.step,
        unit,
        called,
    )
