"""A file system that has an error: the system calls of this process for some files fail with it.

The files are those below the folder STORE_FAILS, while there is a file beside it, of its name and
``.error``, that holds the number of the error.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from typing import Any

FOLDER = os.environ["STORE_FAILS"]
ERROR = f"{FOLDER}.error"
_ASKED = {"open", "os.rename", "os.remove", "os.mkdir", "os.utime", "os.listdir", "os.scandir"}


def _refuse(event: str, arguments: tuple[Any, ...]) -> None:
    if event in _ASKED and str(arguments[0]).startswith(f"{FOLDER}/"):
        _check(arguments[0])


def _check(path: Any) -> None:
    try:
        with open(ERROR) as file:  # noqa: PTH123 (the hot path of the service)
            number = int(file.read())
    except FileNotFoundError:
        return
    raise OSError(number, os.strerror(number), path)


def _refusing(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function that Python does not ask about, with the error for those files."""

    def refusing(target: Any, *arguments: Any, **options: Any) -> Any:
        path = target
        if isinstance(target, int):
            path = os.readlink(f"/proc/self/fd/{target}")  # noqa: PTH115 (it would call this)
        if str(path).startswith(f"{FOLDER}/"):
            _check(path)
        return function(target, *arguments, **options)

    return refusing


sys.addaudithook(_refuse)
os.stat = _refusing(os.stat)
os.fsync = _refusing(os.fsync)
