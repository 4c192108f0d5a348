"""Code, documentation and messages use one word for one thing: the field's standard term."""

from __future__ import annotations

import ast
import re
import subprocess
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

REPLACED = {
    r"lattices?": "parameter grid, sweep axes",
    r"members?": "solution of the family",
    r"real (members?|solutions?|motions?)|(members?|solutions?|motions?) (is|are) real"
    r"|real (and|or|from) phantoms?|phantoms? (and|or|from) real": "admissible",
    r"walk(s|ed|ing)?": "certified path check",
    r"flights?": "free motion between impacts",
    r"held structures?|structures? held": "structure with the constrained DOFs held fixed",
    r"spoil(s|ed)?": "invalidates",
    r"dearest": "most expensive",
    r"(even|odd) (motion|member|solution)s?": "symmetric, antisymmetric component",
    r"intakes?": "parse",
    r"wire": "connection",
    r"ledgers?": "records",
    r"leases?|leased": "claim",
    r"spot": "on submission",
    r"bundles?": "container, batch",
    r"spool(s|ed)?": "rows on disk",
    r"nursery": "forkserver",
    r"lanes?": "queue",
    r"floors": "lower bounds of the hardware",
    r"crowds?": "concurrent clients",
    r"who may ask": "authentication",
    r"good for": "permits",
}
"""Pattern of a word that has a better one -> the better one."""

_MEMBER = "members?"
_OF_THE_ENSEMBLE = "the member of an ensemble, a dimension of its results"
EXCEPTIONS: dict[tuple[str, str], str] = {
    ("solvers/.*/(ensemble/.*|results/ensemble|time_history/many).py", _MEMBER): _OF_THE_ENSEMBLE,
    ("openapi/vibroimpact_schema/(motions|requests).py", _MEMBER): _OF_THE_ENSEMBLE,
    (
        "client/vibroimpact/(computations/histories|motion_plots|result_file).py",
        _MEMBER,
    ): _OF_THE_ENSEMBLE,
    ("client/vibroimpact/(documents|kinds).py", _MEMBER): _OF_THE_ENSEMBLE,
    ("docs/(theory/time-histories|service/files).md", _MEMBER): _OF_THE_ENSEMBLE,
    ("benchmarks/(skips/sweeps|scaling).py|changes/.*", _MEMBER): _OF_THE_ENSEMBLE,
    ("tests/.*/test_(ensemble|many|matrix|results|client).py", _MEMBER): _OF_THE_ENSEMBLE,
    ("docs/reference/client.md|mkdocs.yml", _MEMBER): "an option of mkdocstrings",
    ("benchmarks/guard.py", "members?|walks|flights|good for"): "names of kernels in 0.1.0",
    ("tests/benchmarks/test_guard.py", "good for"): "an attribute in a comprehension",
    ("(tests/.*|solvers/.*/kernels/sources).py", "walk"): "the function ast.walk",
    ("solvers/vibroimpact_solvers/plan.py", "flight"): "a stage in plan documents",
    (
        "tests/.*/test_(long_histories|ensemble|attractors|slow_flow).py",
        "flight",
    ): "a stage in plan documents",
    ("changes/.*", "flights"): "a name in 0.1.0",
    (
        "service/.*/jobs/(tables|migrations/.*).py",
        "leases?|leased|lanes?",
    ): "columns of the database",
    ("changes/.*|docs/service/settings.md", "spot"): "the table of former settings",
    ("service/.*/settings.py|tests/service/test_settings.py", "spot"): "a former setting",
    ("tests/reference/make_data.py", "ledger|spot"): "names in 0.1.0, which the script runs",
    ("solvers/.*/(kernels/(response|damped_walls)|time_history/basis).py", "lanes?"): "SIMD lanes",
    ("tests/benchmarks/test_vector_loops.py", "lanes?"): "SIMD lanes",
}
"""(pattern of a path, pattern of a matched word) -> the reason why it stays there."""

SUFFIXES = {".py", ".md", ".toml", ".yaml", ".yml", ".js", ".html", ".css", ".sbatch", ""}
OUTSIDE = (
    "CHANGELOG.md",
    "benchmarks/results/",
    "docs/benchmarks/",
    "docs/katex/",
    "tests/acceptance/test_vocabulary.py",
)
"""The changelog, kept results and the pages written from them, KaTeX, and the list above."""


@cache
def _files() -> dict[Path, str]:
    """Return the files of the project and their texts."""
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True, text=True
    )
    return {
        Path(name): (ROOT / name).read_text(encoding="utf-8")
        for name in listed.stdout.split("\0")
        if name and Path(name).suffix in SUFFIXES and not name.startswith(OUTSIDE)
    }


def _occurrences(path: Path, text: str, pattern: re.Pattern[str]) -> list[str]:
    """Return path, line and word of each occurrence that no exception covers."""
    occurrences: list[str] = []
    whole = f"{path.as_posix()}\n{text}"
    lines = whole.splitlines() if pattern.search(whole) else ()
    for number, line in enumerate(lines):
        occurrences += [
            f"{path}:{number}: {match[0]}"
            for match in pattern.finditer(line)
            if not any(
                re.fullmatch(where, path.as_posix()) and re.fullmatch(what, match[0], re.I)
                for where, what in EXCEPTIONS
            )
        ]
    return occurrences


@pytest.mark.parametrize(("pattern", "better"), REPLACED.items())
def test_a_word_with_a_better_one_is_not_used(pattern: str, better: str) -> None:
    """Parts of identifiers count as words, and so do those of paths, as line 0."""
    word = re.compile(rf"(?<![a-zA-Z])({pattern})(?![a-zA-Z])", re.I)
    occurrences = [each for file in _files().items() for each in _occurrences(*file, word)]
    assert occurrences == [], f"write: {better}"


def test_no_variable_is_called_found() -> None:
    """A name says what the thing is that was found; tests may still use the word."""
    places = []
    for path, text in _files().items():
        if path.suffix == ".py" and path.parts[0] != "tests":
            tree = ast.parse(text)
            places += [
                f"{path}:{node.lineno}"
                for node in ast.walk(tree)
                if (isinstance(node, ast.Name) and node.id == "found")
                or (isinstance(node, ast.arg) and node.arg == "found")
            ]
    assert places == []
