"""Settings: what is wrong with them is said in words, and the documentation has all of them."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path
from typing import Any

import pytest

from vibroimpact_service.settings import (
    RENAMED,
    Settings,
    SettingsInvalidError,
    read,
    renamed,
    unknown,
)

PAGE = Path(__file__).parents[2] / "docs" / "service" / "settings.md"
ROW = re.compile(r"^\| `VIBROIMPACT_([A-Z0-9_]+)` \| (.+?) \| (.+) \|$", re.M)
# The last two are those of the examples' proxy and batch script.
OF_CLIENTS = {"url", "key", "profile", "timeout", "name", "tls"}
OF_THE_MACHINE = {"workers", "inline_threads"}


def _documented(text: str, default: Any) -> Any:
    """Return what a cell of the page says, as a value of the default's type."""
    if text == "–":
        return None
    plain = text.strip("`")
    if isinstance(default, bool | int | float | tuple):
        value = json.loads(plain)
        return tuple(value) if isinstance(value, list) else value
    return plain if isinstance(default, str) else type(default)(plain)


def test_the_page_has_every_setting_with_its_default_and_meaning() -> None:
    found = ROW.findall(PAGE.read_text())
    rows = {name.lower(): (default, meaning) for name, default, meaning in found}
    assert set(rows) == set(Settings.model_fields)
    for name, field in Settings.model_fields.items():
        default, meaning = rows[name]
        assert meaning == field.description
        if name in OF_THE_MACHINE:
            assert "cores" in default
        else:
            assert _documented(default, field.default) == field.default, name


def test_pages_name_no_variable_that_is_not_there() -> None:
    pages = [PAGE.parents[2] / "README.md", *PAGE.parents[1].rglob("*.md")]
    for page in pages:
        named = {
            name.lower() for name in re.findall(r"VIBROIMPACT_([A-Z_]*[A-Z])", page.read_text())
        }
        assert named - set(Settings.model_fields) - OF_CLIENTS == set(), page


def test_a_wrong_value_is_named_by_its_variable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VIBROIMPACT_PORT", "eight")
    monkeypatch.setenv("VIBROIMPACT_WORKERS", "0")
    with pytest.raises(SettingsInvalidError, match=r"VIBROIMPACT_PORT: .*integer") as caught:
        read()
    assert "VIBROIMPACT_WORKERS: " in str(caught.value)


def test_a_list_that_is_no_json_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VIBROIMPACT_CORS_ORIGINS", "https://a.b")
    with pytest.raises(SettingsInvalidError, match=r"cors_origins.*written as JSON"):
        read()


def test_arguments_win_and_those_not_given_do_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VIBROIMPACT_PORT", "9000")
    monkeypatch.setenv("VIBROIMPACT_HOST", "127.0.0.2")
    found = read(port=9001, host=None)
    assert (found.host, found.port) == ("127.0.0.2", 9001)


def test_misspelt_variables_are_found() -> None:
    environment = {
        **os.environ,
        "VIBROIMPACT_WORKER": "3",
        "VIBROIMPACT_WORKERS": "3",
        "vibroimpact_store": "s3://b",
        "VIBROIMPACT_KEY": "vik_",
        "VIBROIMPACT_TEST_POSTGRESQL": "1",
        "VIBROIMPACT_TLS": "/shared/tls",
        "VIBROIMPACT_NAME": "vibroimpact.example",
    }
    assert unknown(environment) == ["VIBROIMPACT_WORKER"]
    assert unknown(["VIBROIMPACT_TLS_CERTIFICATE"]) == ["VIBROIMPACT_TLS_CERTIFICATE"]


def test_names_of_0_1_0_are_still_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VIBROIMPACT_DRIVEN_JOBS", "3")
    monkeypatch.setenv("VIBROIMPACT_SPOT_SECONDS", "0.5")
    with pytest.warns(DeprecationWarning, match="is now called VIBROIMPACT_"):
        old = read()
    assert (old.running_jobs, old.on_submission_seconds) == (3, 0.5)
    assert renamed(os.environ) == {
        "VIBROIMPACT_DRIVEN_JOBS": "VIBROIMPACT_RUNNING_JOBS",
        "VIBROIMPACT_SPOT_SECONDS": "VIBROIMPACT_ON_SUBMISSION_SECONDS",
    }
    assert unknown(os.environ) == []
    monkeypatch.setenv("VIBROIMPACT_RUNNING_JOBS", "5")
    monkeypatch.delenv("VIBROIMPACT_SPOT_SECONDS")
    for given, taken in (({}, 5), ({"running_jobs": 7}, 7)):
        with pytest.warns(DeprecationWarning, match="VIBROIMPACT_DRIVEN_JOBS is now called"):
            assert read(**given).running_jobs == taken
    monkeypatch.delenv("VIBROIMPACT_DRIVEN_JOBS")
    monkeypatch.delenv("VIBROIMPACT_RUNNING_JOBS")
    with pytest.warns(DeprecationWarning, match="VIBROIMPACT_DRIVEN_JOBS is now called"):
        assert read(driven_jobs=9).running_jobs == 9


def test_a_wrong_value_under_an_old_name_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VIBROIMPACT_DRIVEN_JOBS", "none")
    with (
        pytest.warns(DeprecationWarning, match="VIBROIMPACT_DRIVEN_JOBS is now called"),
        pytest.raises(SettingsInvalidError, match="VIBROIMPACT_RUNNING_JOBS"),
    ):
        read()


def test_the_page_lists_the_old_names() -> None:
    found = re.findall(r"^\| `([A-Z_]+)` \| `VIBROIMPACT_([A-Z_]+)` \|$", PAGE.read_text(), re.M)
    assert {old.lower(): new.lower() for old, new in found} == RENAMED
