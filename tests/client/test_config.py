"""Arguments before the environment before the file of profiles; keys only to their addresses."""

from __future__ import annotations

from pathlib import Path

import pytest

from vibroimpact.config import TIMEOUT, Connection, connection
from vibroimpact.errors import ConfigurationError

FILE = """
default = "lab"

[profiles.lab]
url = "https://lab.example"
key = "vik_lab"
timeout = 120

[profiles.cluster]
url = "https://cluster.example"
"""


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    path = tmp_path / "config.toml"
    path.write_text(FILE)
    return {"VIBROIMPACT_CONFIG": str(path)}


def test_nothing_said_means_a_service_of_our_own(tmp_path: Path) -> None:
    empty = {"XDG_CONFIG_HOME": str(tmp_path)}
    assert connection(environment=empty) == Connection(None, None, TIMEOUT)


def test_the_default_profile(environment: dict[str, str]) -> None:
    assert connection(environment=environment) == Connection("https://lab.example", "vik_lab", 120)


def test_a_profile_by_name(environment: dict[str, str]) -> None:
    chosen = connection(profile="cluster", environment=environment)
    assert chosen == Connection("https://cluster.example", None, TIMEOUT)
    environment["VIBROIMPACT_PROFILE"] = "cluster"
    assert connection(environment=environment) == chosen


def test_the_environment_goes_before_the_file(environment: dict[str, str]) -> None:
    environment |= {"VIBROIMPACT_URL": "http://here:1", "VIBROIMPACT_TIMEOUT": "5"}
    assert connection(environment=environment) == Connection("http://here:1", None, 5.0)
    environment["VIBROIMPACT_KEY"] = "vik_env"
    assert connection(environment=environment).key == "vik_env"


def test_arguments_go_before_all(environment: dict[str, str]) -> None:
    environment |= {"VIBROIMPACT_URL": "http://here:1", "VIBROIMPACT_KEY": "vik_env"}
    chosen = connection("http://there:2", "vik_mine", 1.0, environment=environment)
    assert chosen == Connection("http://there:2", "vik_mine", 1.0)
    del environment["VIBROIMPACT_KEY"]
    named = connection(profile="lab", environment=environment)
    assert (named.url, named.key) == ("https://lab.example", "vik_lab")


def test_the_key_of_a_profile_goes_to_no_other_address(environment: dict[str, str]) -> None:
    assert connection("http://there:2", profile="lab", environment=environment).key is None
    environment["VIBROIMPACT_URL"] = "http://here:1"
    assert connection(environment=environment).key is None


@pytest.mark.parametrize(
    ("file", "profile", "message"),
    [
        (FILE, "no-such", "no profile 'no-such'"),
        ("default = ", None, "config.toml"),
        ('default = "a"\n[profiles.a]\nurl = 5', None, "url is not understood"),
        ('default = "a"\n[profiles.a]\nhost = "x"', None, "host is not understood"),
        ('default = "a"\nprofiles = 3', None, "no profile 'a'"),
    ],
)
def test_files_that_cannot_be_understood(
    tmp_path: Path, file: str, profile: str | None, message: str
) -> None:
    path = tmp_path / "config.toml"
    path.write_text(file)
    with pytest.raises(ConfigurationError, match=message):
        connection(profile=profile, environment={"VIBROIMPACT_CONFIG": str(path)})


def test_a_profile_needs_a_file(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="no configuration file"):
        connection(profile="lab", environment={"XDG_CONFIG_HOME": str(tmp_path)})
    with pytest.raises(ConfigurationError, match="'soon', not a number"):
        connection(environment={"XDG_CONFIG_HOME": str(tmp_path), "VIBROIMPACT_TIMEOUT": "soon"})
