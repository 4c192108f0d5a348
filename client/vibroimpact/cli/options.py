"""Arguments and options that several commands have, and what they stand for."""

from __future__ import annotations

import json
import sys
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from vibroimpact.arguments import hyphenated
from vibroimpact.client import Client
from vibroimpact.config import connection
from vibroimpact.errors import NeglectedWarning, StructureWarning
from vibroimpact.kinds import KINDS
from vibroimpact.results import Result

if TYPE_CHECKING:
    from vibroimpact.documents import Kind as Kind
else:  # any word: a service can be newer than this program
    Kind = Annotated[
        str,
        typer.Argument(
            help=f"Kind of computation: {', '.join(KINDS)}.",
            autocompletion=lambda: list(KINDS),
            callback=hyphenated,  # they may be spelt as methods of the client are
        ),
    ]
RequestFile = Annotated[
    str, typer.Argument(help="File of the request (JSON); - for standard input.", metavar="FILE")
]
Model = Annotated[
    list[Path] | None,
    typer.Option(
        help="File with matrices of the structure, as read_model reads it; given once for each "
        "file. The request's system adds stops, damping, units.",
        dir_okay=False,
    ),
]
Url = Annotated[str | None, typer.Option(help="Address of the service.", envvar="VIBROIMPACT_URL")]
Profile = Annotated[
    str | None,
    typer.Option(help="Profile of the configuration file.", envvar="VIBROIMPACT_PROFILE"),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
Out = Annotated[
    Path | None, typer.Option("--out", "-o", help="File of the result (HDF5).", dir_okay=False)
]
Plot = Annotated[
    Path | None, typer.Option(help="File of a plot: .png, .pdf or .svg.", dir_okay=False)
]
Output = Annotated[str | None, typer.Option(help="The output that is plotted.")]


def request(file: str, model: Sequence[Path] | None = None) -> Any:
    """Return the request in a file or on standard input, about a model where there is one.

    With a model, nothing on the standard input of a terminal stands for an empty request.

    Raises
    ------
    ValueError
        If it is not a JSON object, or the model cannot be read.
    """
    document = _document(file, optional=bool(model))
    if not model:
        return document
    from vibroimpact.models import read_model  # needs scipy

    return document | {"system": read_model(*model).system(()) | document.get("system", {})}


def _document(file: str, *, optional: bool) -> dict[str, Any]:
    """Return the JSON object in a file or on standard input."""
    if optional and file == "-" and sys.stdin.isatty():
        return {}
    text = sys.stdin.read() if file == "-" else Path(file).read_text(encoding="utf-8")
    if optional and not text.strip():
        return {}
    try:
        document = json.loads(text)
    except ValueError as error:
        where = "standard input" if file == "-" else file
        hint = "" if text.lstrip()[:1] in "{[" else "; files with matrices are given by --model"
        raise ValueError(f"{where} is no request in JSON: {error}{hint}") from None
    match document:
        case dict():
            return document
        case _:
            raise ValueError("a request is a JSON object")


def client(url: str | None, profile: str | None) -> Client:
    """Return a client of the service that is configured.

    Raises
    ------
    ValueError
        If none is: jobs of a service that ends with the command would be lost.
    """
    if connection(url, profile=profile).url is None:
        raise ValueError("no service is known: give --url, or run  vibroimpact login URL")
    return Client(url, profile=profile)


def fetched(get: Callable[[], Result]) -> Result:
    """Return a result; what it neglects is said by `show`, and not by a warning of Python."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NeglectedWarning)
        warnings.simplefilter("ignore", StructureWarning)
        return get()


def show(result: Result, out: Path | None, plot: Path | None, output: str | None) -> None:
    """Write the files that were asked for, and say so; without any, say what the result has."""
    said = Console(stderr=True, soft_wrap=True)
    for sentence in (*result.neglected, *result.cautions):
        said.print(f"caution: {sentence}", highlight=False, markup=False, style="yellow")
    if out is not None:
        said.print(f"written: {result.to_hdf5(out)}", highlight=False)
    if plot is not None:
        from vibroimpact import style

        style.save(result.plot(output=output), plot)
        said.print(f"written: {plot}", highlight=False)
