"""Writes the types of the client: documents from the contract, results from their declarations.

``python client/write_types.py`` writes `vibroimpact.documents` and `vibroimpact.kinds`;
``--check`` fails where they are not what would be written.
"""

from __future__ import annotations

import json
import keyword
import subprocess
import sys
import textwrap
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from vibroimpact_service.kinds import KINDS
from vibroimpact_service.result_documents import formula
from vibroimpact_service.results.hdf5 import axes
from vibroimpact_solvers.arrays import Field, declared
from vibroimpact_solvers.results.shared import DERIVATIVES

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "client" / "vibroimpact"
SCHEMAS = json.loads((ROOT / "openapi" / "openapi.json").read_text())["components"]["schemas"]
REQUESTS = {name: kind.request.__name__ for name, kind in KINDS.items()}
ABOUT = {
    "CalibrationRequest": "Unknown numbers of a request, and measurements.",
    "SweepRequest": "A computation over a parameter grid.",
}
"""Requests that are one of several documents, one for each kind of their base."""
FORMS = {
    name: tuple(one["$ref"].rpartition("/")[2] for one in SCHEMAS[name]["oneOf"]) for name in ABOUT
}
BASES = {DERIVATIVES["derivative"].about: "Derivatives"}
"""What the tables of some groups can do besides."""
CAPABLE = {"time-history": "Motion"}
"""What results of some kinds can do besides."""
ALWAYS = ("neglected", "cautions")
"""What all results have."""
OTHERS = ("Job", "Plan", "Version", "StoredSystem")


# -- Documents ------------------------------------------------------------------------------


def documents() -> str:
    """Return the module of documents."""
    single = [name for name in REQUESTS.values() if name not in FORMS]
    of_bases = [form for forms in FORMS.values() for form in forms]
    given = _reachable((*single, *of_bases, "Webhook"))
    rest = [name for name in _reachable(OTHERS) if name not in given]
    classes = [_document(name, given=True) for name in given]
    classes += [_document(name, given=False) for name in rest]
    presets = SCHEMAS["System"]["oneOf"][1]["oneOf"]
    system = ("MatrixSystem", *(one["$ref"].rpartition("/")[2] for one in presets))
    aliases = {
        "System": ("A structure.", (*system, "SystemReference")),
        **{name: (about, FORMS[name]) for name, about in ABOUT.items()},
        "Request": ("A request of any kind.", tuple(REQUESTS.values())),
        "BaseRequest": ("What a sweep computes at every point.", _bases("SweepRequest")),
        "CalibratedRequest": (
            "What a calibration fits to measurements.",
            _bases("CalibrationRequest"),
        ),
    }
    kinds = ", ".join(f'"{name}"' for name in KINDS)
    head = f'''\
"""The documents of the HTTP interface as types: ``structure: Chain = {{"preset": "chain", …}}``.

Written by ``client/write_types.py`` from ``openapi.json``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, NotRequired, TypedDict

Kind = Literal[{kinds}]
"""Kinds of computation."""
'''
    ends = [
        f'{name} = {" | ".join(parts)}\n"""{about}"""\n' for name, (about, parts) in aliases.items()
    ]
    keywords = {
        field: f"NotRequired[{_type(content, given=True)}]"
        for name in given
        for field, content in SCHEMAS[name].get("properties", {}).items()
        if keyword.iskeyword(field)
    }
    bases = [_with_keyword(*each)[1] for each in keywords.items()]
    return "\n\n".join([head, *bases, *classes, "\n".join(ends)])


def _bases(request: str) -> tuple[str, ...]:
    """Return the requests that may be the base of a request."""
    kinds = (SCHEMAS[one]["properties"]["kind"]["const"] for one in FORMS[request])
    return tuple(REQUESTS[kind] for kind in kinds)


def _reachable(roots: tuple[str, ...]) -> list[str]:
    """Return the names of schemas that others refer to, and their own."""
    known: dict[str, None] = {}
    todo = list(roots)
    while todo:
        name = todo.pop(0)
        if name not in known and name not in ("System", "SweepRequest"):
            known[name] = None
            todo += list(_references(SCHEMAS[name]))
    return list(known)


def _references(schema: Any) -> Iterator[str]:
    if isinstance(schema, Mapping):
        if isinstance(schema.get("$ref"), str):
            yield schema["$ref"].rpartition("/")[2]
        for part in schema.values():
            yield from _references(part)
    elif isinstance(schema, list):
        for part in schema:
            yield from _references(part)


def _document(name: str, *, given: bool) -> str:
    """Return a class; documents that users give take any sequences."""
    schema = SCHEMAS[name]
    base, lines = "TypedDict", [_doc(schema["description"])]
    for field, content in schema["properties"].items():
        kind = "System" if field == "system" else _type(content, given=given)
        if field not in schema.get("required", ()):
            kind = f"NotRequired[{kind}]"
        if keyword.iskeyword(field):
            base = _with_keyword(field, kind)[0]
        else:
            lines += [f"    {field}: {kind}", *_about(content.get("description"))]
    return "\n".join([f"class {name}({base}):", *lines]) + "\n"


def _with_keyword(field: str, kind: str) -> tuple[str, str]:
    """Return a class with a field that no class can name, a keyword of Python: its name and it."""
    name = f"_{field.capitalize()}"
    return name, f'{name} = TypedDict("{name}", {{"{field}": {kind}}})\n'


def _about(text: str | None) -> list[str]:
    return [_doc(text)] if text else []


def _doc(text: str) -> str:
    """Return a docstring, indented."""
    first, _, rest = text.replace("\\", "\\\\").partition("\n\n")
    lines = textwrap.wrap(" ".join(first.split()), 88)
    if rest:
        lines += ["", *textwrap.wrap(" ".join(rest.split()), 92)]
    elif len(lines) > 1:
        lines = [lines[0], *textwrap.wrap(" ".join(lines[1:]), 92)]
    end = "\n" if len(lines) > 1 else ""
    return textwrap.indent('"""' + "\n".join(lines) + end + '"""', "    ")


_PLAIN = {"string": "str", "number": "float", "integer": "int", "boolean": "bool", "null": "None"}


def _type(schema: Mapping[str, Any], *, given: bool) -> str:
    match schema:
        case {"$ref": address}:
            return str(address.rpartition("/")[2])
        case {"const": value}:
            return f"Literal[{json.dumps(value)}]"
        case {"enum": values}:
            return f"Literal[{', '.join(map(json.dumps, values))}]"
        case {"oneOf": parts} | {"anyOf": parts}:
            return " | ".join(dict.fromkeys(_type(part, given=given) for part in parts))
        case {"type": "array"}:
            inner = _type(schema.get("items", {}), given=given)
            return f"{'Sequence' if given else 'list'}[{inner}]"
        case {"type": "object", "additionalProperties": dict(values)}:
            return f"Mapping[str, {_type(values, given=given)}]"
        case {"type": "object"}:
            return "Mapping[str, Any]"
        case {"type": plain}:
            return _PLAIN[plain]
    return "Any"


# -- Results --------------------------------------------------------------------------------


def results() -> str:
    """Return the module of result classes."""
    tables = Tables()
    classes = [_result(name, tables) for name in KINDS]
    names = [_class(name) for name in KINDS]
    table = ",\n".join(f'    "{kind}": {name}' for kind, name in zip(KINDS, names, strict=True))
    head = '''\
"""The results of each kind of computation: which outputs there are, and what they mean.

Written by ``client/write_types.py`` from the declarations of the solvers. Outputs are absent where
they were not requested.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final

from vibroimpact.errors import warn_of_structure
from vibroimpact.parts import Parts
from vibroimpact.derivatives import Derivatives
from vibroimpact.response_spectra import Motion
from vibroimpact.result_file import reading
from vibroimpact.results import Result
from vibroimpact.tables import Table

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from vibroimpact import documents

    Floats = NDArray[np.float64]
    Integers = NDArray[np.int64]
    Booleans = NDArray[np.bool_]
    Words = NDArray[np.str_]
'''
    end = f'''\
KINDS: Final[dict[str, type[Result]]] = {{
{table},
}}
"""Name of a kind -> class of its results."""


def read(content: bytes | Path | Parts) -> Result:
    """Return a result as what it is: the file of it, where that lies, or what it would have.

    Warns of what of the structure has no effect on it (`NeglectedWarning`), and of what is
    seldom meant in it (`StructureWarning`).
    """
    with reading(content) as file:
        kind = str(file.attrs["kind"])
    result = KINDS.get(kind, Result)(content)
    warn_of_structure(result.kind, result.neglected, result.cautions)
    return result
'''
    return "\n\n".join([head, *tables.classes.values(), *classes, end])


class Tables:
    """The classes of tables: several kinds share those that are alike."""

    def __init__(self) -> None:
        self.classes: dict[str, str] = {}
        self._columns: dict[str, list[str]] = {}

    def add(self, title: str, about: str, columns: list[str]) -> str:
        """Add a class, unless there is one with these columns; return its name."""
        base, own = BASES.get(about, "Table"), columns
        for name, known in self._columns.items():
            if known == columns:
                return name
            if known == columns[: len(known)]:
                base, own = name, columns[len(known) :]
        self._columns[title] = columns
        self.classes[title] = "\n".join([f"class {title}({base}):", _doc(about), *own]) + "\n"
        return title


def _class(kind: str) -> str:
    return "".join(part.capitalize() for part in kind.split("-"))


def _result(kind: str, tables: Tables) -> str:
    name = _class(kind)
    if kind == "sweep":
        about = "Outputs of the base over a parameter grid."
        lines = [f"class {name}(Result):", _doc(about), "    request: documents.SweepRequest"]
        return (
            "\n".join([*lines, "    status: Words", '    """Whether there is a result."""']) + "\n"
        )
    solver = KINDS[kind].solver.Result
    fields = declared(solver)
    names = axes({field.name: field.quantity for field in fields.values()})
    lines = [f"class {name}({CAPABLE.get(kind, 'Result')}):", _doc(solver.__doc__ or "")]
    lines.append(f"    request: documents.{REQUESTS[kind]}")
    here = [
        field for field in fields.values() if field.quantity.coordinate or not field.quantity.path
    ]
    numbers: list[str] = []
    for field in here:
        if field.array or field.quantity.dims:
            dims = ", ".join(names.of(field.quantity))
            lines += [
                f"    {field.name}: {_values(field, field.name)}",
                _doc(_meaning(field, dims)),
            ]
        elif field.name not in ALWAYS:
            numbers.append(field.name)
            lines += [f"    {field.name}: {_values(field, field.name)}", _doc(_meaning(field, ""))]
    if numbers:
        lines.insert(2, f"    NUMBERS: ClassVar[tuple[str, ...]] = {tuple(numbers)!r}")
    parts = _groups(solver, fields, names, "", tables, name)
    for part, table in parts.items():
        lines += [f"    {part}: {table}", _doc(solver.GROUPS[part].about)]
    if parts:
        entries = ", ".join(f'"{part}": {table}' for part, table in parts.items())
        lines.insert(2, f"    PARTS: ClassVar[dict[str, type[Table]]] = {{{entries}}}")
    return "\n".join(lines) + "\n"


def _groups(
    solver: Any, fields: Mapping[str, Field], names: Any, inside: str, tables: Tables, owner: str
) -> dict[str, str]:
    """Add the classes of the groups right below a path; return them by the names of the groups."""
    parts = {}
    for path, group in solver.GROUPS.items():
        if path.rpartition("/")[0] != inside.rstrip("/"):
            continue
        within = [f for f in fields.values() if f.path.rpartition("/")[0] == path]
        inner = _groups(solver, fields, names, f"{path}/", tables, owner)
        columns = []
        for field in within:
            column = field.path.rpartition("/")[2]
            dims = ", ".join(names.of(field.quantity))
            columns += [f"    {column}: {_values(field, column)}", _doc(_meaning(field, dims))]
        for part, table in inner.items():
            columns += [f"    {part}: {table}", _doc(solver.GROUPS[f"{path}/{part}"].about)]
        if inner:
            entries = ", ".join(f'"{part}": {table}' for part, table in inner.items())
            columns.insert(0, f"    PARTS: ClassVar[dict[str, type[Table]]] = {{{entries}}}")
        title = f"{owner}{''.join(part.capitalize() for part in path.split('/'))}"
        parts[path.rpartition("/")[2]] = tables.add(title, group.about, columns)
    return parts


def _values(field: Field, column: str) -> str:
    if not field.array:
        if field.quantity.dims:
            return "Words"
        return {float: "float", int: "int", bool: "bool", str: "str"}.get(field.scalar, "str")
    if field.quantity.flags:
        return "Booleans" if column == "exists" else "Words"
    return {float: "Floats", int: "Integers", bool: "Booleans"}[field.scalar]


def _meaning(field: Field, dims: str) -> str:
    quantity = field.quantity
    text = quantity.long_name[0].upper() + quantity.long_name[1:]
    text += f", shape ({dims})" if dims else ""
    unit = formula(quantity.unit)
    notes = [quantity.note, f"nan: {quantity.missing}" if quantity.missing else ""]
    return "; ".join(filter(None, [f"{text}, {unit}" if unit else text, *notes])) + "."


# -- Files ----------------------------------------------------------------------------------


def _formatted(text: str) -> str:
    for command in (["check", "--select", "I,F401", "--fix", "--quiet"], ["format", "--quiet"]):
        call = [
            sys.executable,
            "-m",
            "ruff",
            *command,
            "--stdin-filename",
            "client/vibroimpact/x.py",
            "-",
        ]
        text = subprocess.run(
            call, input=text, capture_output=True, text=True, check=True, cwd=ROOT
        ).stdout
    return text


def main() -> str | None:
    """Write the modules, or compare them with what would be written."""
    check = "--check" in sys.argv[1:]
    for name, text in (("documents", documents()), ("kinds", results())):
        path, new = PACKAGE / f"{name}.py", _formatted(text)
        if not check:
            path.write_text(new, encoding="utf-8")
        elif path.read_text(encoding="utf-8") != new:
            return f"{path.relative_to(ROOT)} is not up to date: python client/write_types.py"
    return None


if __name__ == "__main__":
    sys.exit(main())
