"""A hook of mkdocs: writes the tables of result fields from their declarations."""

from __future__ import annotations

import re
from typing import Any

from vibroimpact_service.kinds import KINDS
from vibroimpact_service.result_documents import formula
from vibroimpact_service.results.hdf5 import axes
from vibroimpact_solvers.arrays import declared

_HEAD = "| name | dimensions | unit | meaning | error |\n|---|---|---|---|---|\n"


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Replace lines such as ``<!-- fields of impact-modes -->`` by tables."""
    return re.sub(r"<!-- fields of ([a-z-]+) -->", lambda match: table(match[1]), markdown)


def table(kind: str) -> str:
    """Return the table of the fields of a kind's results, with the dimensions' names in files."""
    fields = declared(KINDS[kind].solver.Result).values()
    names = axes({field.name: field.quantity for field in fields})
    rows = []
    for field in fields:
        quantity = field.quantity
        missing = f"null or nan: {quantity.missing}" if quantity.missing else ""
        codes = " or ".join(f"`{flag}`" for flag in quantity.flags)
        cells = (
            f"`{field.path}`",
            ", ".join(f"`{dim}`" for dim in names.of(quantity)),
            formula(quantity.unit),
            "; ".join(filter(None, [quantity.long_name, codes, quantity.note, missing])),
            quantity.error and f"`{quantity.error}`",
        )
        rows.append(f"| {' | '.join(cells)} |\n")
    return _HEAD + "".join(rows)
