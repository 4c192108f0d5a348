"""Address and key of the service, from arguments, the environment or a file of profiles.

Arguments override the environment, and the environment overrides the file. The file is
``~/.config/vibroimpact/config.toml``, or the one that VIBROIMPACT_CONFIG names::

    default = "lab"

    [profiles.lab]
    url = "https://vibroimpact.lab.example"
    key = "vik_..."
    timeout = 120
"""

from __future__ import annotations

import json
import os
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from vibroimpact.errors import ConfigurationError

TIMEOUT: Final = 60.0
"""Default of the longest wait for one answer, in seconds."""
_FIELDS: Final[Mapping[str, tuple[type, ...]]] = {
    "url": (str,),
    "key": (str,),
    "timeout": (int, float),
}


@dataclass(frozen=True, slots=True)
class Connection:
    """Address, key and timeout of a service; without an address, the client starts one."""

    url: str | None
    key: str | None
    timeout: float


def connection(
    url: str | None = None,
    key: str | None = None,
    timeout: float | None = None,
    profile: str | None = None,
    environment: Mapping[str, str] = os.environ,
) -> Connection:
    """Return the connection that arguments, environment and file define together.

    The key of a profile is sent to the address of that profile and to no other.

    Raises
    ------
    ConfigurationError
        If the environment or the file is wrong.
    """
    chosen = profile or environment.get("VIBROIMPACT_PROFILE")
    given_url = url or environment.get("VIBROIMPACT_URL")
    # A profile given as an argument overrides an address in the environment.
    if profile is not None and url is None:
        given_url = None
    values = {} if given_url is not None and chosen is None else _profile(chosen, environment)
    address = given_url or values.get("url")
    own = values if address == values.get("url") else {}
    wait = timeout if timeout is not None else _seconds(environment) or values.get("timeout")
    return Connection(
        address,
        key or environment.get("VIBROIMPACT_KEY") or own.get("key"),
        TIMEOUT if wait is None else float(wait),
    )


def save(
    profile: str, url: str, key: str | None, environment: Mapping[str, str] = os.environ
) -> Path:
    """Write a profile to the configuration file and make it the default; return the path.

    The file can be read by its owner alone. What else it contains is kept, without comments.
    """
    path = _path(environment)
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        content = {}
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ConfigurationError(f"{path}: {error}") from None
    profiles = dict(content.get("profiles", {}))
    profiles[profile] = {"url": url} | ({} if key is None else {"key": key})
    lines = [f"default = {json.dumps(profile)}"]
    for name, fields in profiles.items():
        lines += ["", f"[profiles.{json.dumps(name)}]"]
        lines += [f"{field} = {json.dumps(value)}" for field, value in fields.items()]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch(mode=0o600)
    path.chmod(0o600)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def _seconds(environment: Mapping[str, str]) -> float | None:
    text = environment.get("VIBROIMPACT_TIMEOUT")
    try:
        return None if text is None else float(text)
    except ValueError:
        raise ConfigurationError(f"VIBROIMPACT_TIMEOUT is {text!r}, not a number") from None


def _profile(name: str | None, environment: Mapping[str, str]) -> dict[str, Any]:
    path = _path(environment)
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        if name is None:
            return {}
        raise ConfigurationError(f"there is no configuration file {path}") from None
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ConfigurationError(f"{path}: {error}") from None
    chosen = name or content.get("default")
    if chosen is None:
        return {}
    profiles = content.get("profiles", {})
    if not isinstance(profiles, dict) or not isinstance(profiles.get(chosen), dict):
        raise ConfigurationError(f"{path} has no profile {chosen!r}")
    values: dict[str, Any] = profiles[chosen]
    for field, value in values.items():
        if field not in _FIELDS or not isinstance(value, _FIELDS[field]):
            raise ConfigurationError(f"{path}: profile {chosen!r}: {field} is not understood")
    return values


def _path(environment: Mapping[str, str]) -> Path:
    if "VIBROIMPACT_CONFIG" in environment:
        return Path(environment["VIBROIMPACT_CONFIG"]).expanduser()
    base = environment.get("XDG_CONFIG_HOME") or "~/.config"
    return Path(base).expanduser() / "vibroimpact" / "config.toml"
