"""What goes out under one name says the same everywhere."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import yaml
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[2]
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_the_version_is_the_same_everywhere() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    recipe = yaml.safe_load((ROOT / "conda" / "recipe.yaml").read_text())
    assert citation["version"] == recipe["context"]["version"] == PROJECT["version"]
    assert citation["license"] == recipe["about"]["license"] == PROJECT["license"]


def test_the_conda_package_needs_what_the_wheel_and_its_command_need() -> None:
    recipe = yaml.safe_load((ROOT / "conda" / "recipe.yaml").read_text())
    wheel = [*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["cli"]]
    needed = {str(Requirement(text)) for text in wheel}
    stated = {text.replace(" ", "") for text in recipe["requirements"]["run"]}
    assert stated - {f"python{PROJECT['requires-python']}"} == needed


def test_files_that_the_readme_shows_are_there() -> None:
    text = (ROOT / "README.md").read_text()
    addresses = re.findall(r"\]\(([^)#]+)", text)
    assert len(addresses) > 5
    assert [each for each in addresses if not (ROOT / each).exists()] == []
