"""Numbers of requests that vary: found by the path that names them, replaced by other values."""

from __future__ import annotations

from dataclasses import dataclass
from types import NoneType
from typing import Any, Final

from pydantic import BaseModel, ValidationError

from vibroimpact_service import validation
from vibroimpact_solvers.errors import ModelError

Path = tuple[str | int, ...]

_SIZES: Final = frozenset({"n", "num", "shape", "count"})
_SORTS: Final = {NoneType: "null", bool: "true or false", str: "text", list: "a list"}
OTHER_SIZE: Final = ModelError(
    (), "the results would have other sizes than those of the base", code="shapes_differ"
)


@dataclass(frozen=True, slots=True)
class Varying:
    """A number of a request that varies."""

    path: Path
    mirror: Path | None
    """Leads to the entry of a symmetric matrix that is equal to it."""
    whole: bool
    """Whether it is an integer."""

    def put(self, base: Any, value: float) -> Any:
        """Return the request with another value, without checking it."""
        number = self.number(value)
        changed = replaced(base, self.path, number)
        return changed if self.mirror is None else replaced(changed, self.mirror, number)

    def number(self, value: float) -> float:
        """Return a value as the field takes it."""
        return int(value) if self.whole else value

    def fits(self, base: Any, value: float) -> None:
        """Raise where the field may not have that value."""
        changed = self.put(base, value)
        document = _innermost(changed, self.path)
        content = dict(document)
        try:
            type(document).model_validate(content)
        except ValidationError as error:
            fault = validation.problem_of(error, content).errors[0]
            raise ModelError((), fault.message, code=fault.code) from None
        # Before anything of that size is allocated.
        if _frequencies(changed) != _frequencies(base):
            raise OTHER_SIZE


def number(base: Any, text: str) -> Varying:
    """Return the number at a path of a request.

    Raises
    ------
    ModelError
        Where there is none, with the pointer to the path.
    """
    here: Any = base
    path: Path = ()
    for part in text.split("."):
        step = _step(here, part)
        if step is None:
            where = ".".join(map(str, path)) or "the base"
            absent = "; it is not given" if here is None else ""
            message = f"there is no {part!r} in {where}{absent}{_meant(base, text)}"
            raise ModelError(("path",), message, code="unknown_path")
        path = (*path, step)
        here = _get(here, step)
    if isinstance(here, bool) or not isinstance(here, (int, float)):
        message = f"{text} is {_SORTS.get(type(here), 'an object')}, not a number"
        raise ModelError(("path",), message, code="not_a_number")
    if next(part for part in reversed(path) if isinstance(part, str)) in _SIZES:
        message = f"{text} is a size: results of differing sizes make no grid"
        raise ModelError(("path",), message, code="shapes_differ")
    return Varying(path, _mirror(base, path), isinstance(here, int))


_MOST_PATHS: Final = 3


def _meant(base: Any, text: str) -> str:
    """Return the paths of the base that end as a wrong path does, as a hint."""
    end = text.rpartition(".")[2]
    paths: list[str] = []

    def look(here: Any, path: str) -> None:
        if isinstance(here, BaseModel):
            for name in type(here).model_fields:
                value = getattr(here, name)
                if name == end and isinstance(value, (int, float)):
                    paths.append(path + name)
                look(value, f"{path}{name}.")
        elif isinstance(here, list) and here and isinstance(here[0], BaseModel):
            for index, each in enumerate(here[:_MOST_PATHS]):
                look(each, f"{path}{index}.")

    look(base, "")
    return f"; there is {', '.join(paths[:_MOST_PATHS])}" if paths else ""


def _step(here: Any, part: str) -> str | int | None:
    """Return the name, key or index that a part of a path stands for, None where there is none."""
    if isinstance(here, BaseModel):
        return part if part in type(here).model_fields else None
    if isinstance(here, dict):
        return part if part in here else None
    if isinstance(here, list) and part.isdigit() and len(part) < 10 and int(part) < len(here):
        return int(part)
    return None


def _get(here: Any, step: str | int) -> Any:
    return getattr(here, str(step)) if isinstance(here, BaseModel) else here[step]


def replaced(here: Any, path: Path, value: Any) -> Any:
    """Return a document with another value at a path; the rest is shared with the old one."""
    if not path:
        return value
    step, *rest = path
    inner = replaced(_get(here, step), tuple(rest), value)
    if isinstance(here, BaseModel):
        return here.model_copy(update={str(step): inner})
    copy = here.copy()
    copy[step] = inner
    return copy


def _innermost(document: BaseModel, path: Path) -> BaseModel:
    """Return the innermost document on a path."""
    here: Any = document
    for step in path[:-1]:
        here = _get(here, step)
        if isinstance(here, BaseModel):
            document = here
    return document


def _mirror(base: Any, path: Path) -> Path | None:
    """Return the path of the entry that is equal by symmetry, None where there is no other."""
    match path:
        case ("system", "M" | "K" | "C" | "residual_flexibility", int(i), int(j)) if i != j:
            return (*path[:2], j, i)
        case ("system", "M" | "K" | "C" as name, "data", int(k)):
            matrix = getattr(base.system, name)
            places = list(zip(matrix.row, matrix.col, strict=False))
            i, j = places[k] if k < len(places) else (0, 0)
            if i != j and (j, i) in places:
                return (*path[:3], places.index((j, i)))
    return None


def _frequencies(request: Any) -> int:
    return int(getattr(getattr(request, "frequency", None), "count", 0))
