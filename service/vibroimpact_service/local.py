"""Computations in the calling process, without a server, jobs or a store.

The client imports this module by its name where it is installed; what it returns and raises are
bytes and documents, as over HTTP.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from vibroimpact_service import execute, kinds, problems
from vibroimpact_service.documents import planning, requests
from vibroimpact_service.documents.planning import Planned
from vibroimpact_service.documents.requests import Request
from vibroimpact_service.results import representations
from vibroimpact_service.store import Store
from vibroimpact_solvers.kernels import inventory

_CALLER = "local"


class RefusedError(Exception):
    """A request that is wrong or cannot be computed; `document` is its problem document."""

    def __init__(self, document: dict[str, Any]) -> None:
        super().__init__(document["detail"])
        self.document = document


def compute(
    kind: str, content: Mapping[str, Any], tick: Callable[[int, int], None] | None = None
) -> bytes:
    """Return the HDF5 file of the result of a request.

    Where kernels have to be compiled for it, a line on standard error says so.

    Parameters
    ----------
    kind : str
        Kind of computation, such as ``"impact-modes"``.
    content : mapping
        The request document.
    tick : callable, optional
        Called with the work done and all work.

    Raises
    ------
    RefusedError
    """

    def computed(request: Request, planned: Planned) -> bytes:
        result = execute.compute(planned, request.digest, request.canonical, tick)
        return representations.of_content(result, representations.HDF5).data

    return _planned(kind, content, computed)


def plan(kind: str, content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the plan document of a request.

    Raises
    ------
    RefusedError
    """

    def document(request: Request, planned: Planned) -> dict[str, Any]:
        answer = {"kind": kind, "digest": request.digest, "seconds": planned.seconds}
        return answer | {"cached": False, "inline": True} | planning.steps(planned.plan)

    return _planned(kind, content, document)


Answer = TypeVar("Answer")


def _planned(
    kind: str, content: Mapping[str, Any], answer: Callable[[Request, Planned], Answer]
) -> Answer:
    try:
        request = requests.read(_CALLER, kinds.named(kind, "kind"), dict(content))
        # Systems are stored by servers alone: the store is empty.
        with (
            tempfile.TemporaryDirectory(prefix="vibroimpact-") as folder,
            inventory.announced(),
        ):
            return answer(request, planning.plan(Store(folder), request.kind, request.document))
    except Exception as error:
        fault = problems.of(error)
        if fault.type is problems.INTERNAL:
            raise
        raise RefusedError(fault.document(_CALLER).model_dump(mode="json")) from error
