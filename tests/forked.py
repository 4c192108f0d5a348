"""Programs as processes of their own, without the time that loading their libraries takes.

Each run is a fork of one process that has loaded them: it has its own arguments, environment,
folder, standard streams and end, like a process that was started from nothing.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

_LOOP = """
import gc, importlib, json, os, sys
for name in sys.argv[1:]:
    importlib.import_module(name)
gc.collect()
gc.freeze()  # or each fork, as it ends, would write to all of the memory, and so copy it
for line in sys.stdin:
    asked = json.loads(line)
    if os.fork() == 0:
        break  # the rest is the program: it ends as programs do, with this interpreter
    print(os.waitstatus_to_exitcode(os.wait()[1]), flush=True)
else:
    sys.exit()
for number, name in enumerate(("stdin", "stdout", "stderr")):
    stream = os.open(asked[name], os.O_RDONLY if number == 0 else os.O_WRONLY)
    os.dup2(stream, number)
    os.close(stream)
sys.stdin = open(0)
os.environ.clear()
os.environ.update(asked["environment"])
os.chdir(asked["folder"])
sys.path[:0] = asked["places"]
sys.argv = ["-c", *asked["arguments"]]
code = compile(asked["code"], "<string>", "exec")
exec(code, {"__name__": "__main__"})
"""


class Forked:
    """Runs programs in forks of a process.

    Parameters
    ----------
    *modules : str
        What the process loads.
    environment : mapping, optional
        Environment in which it loads them; default: that of the tests.
    """

    def __init__(self, *modules: str, environment: Mapping[str, str] | None = None) -> None:
        self._environment = dict(os.environ if environment is None else environment)
        self._process = subprocess.Popen(
            [sys.executable, "-c", _LOOP, *modules],
            env=self._environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def __call__(
        self,
        code: str,
        *arguments: str,
        text: str = "",
        environment: Mapping[str, str] | None = None,
        folder: Path | None = None,
        places: tuple[Path, ...] = (),
    ) -> subprocess.CompletedProcess[str]:
        """Run a program and return what it wrote and how it ended.

        Parameters
        ----------
        code : str
            The program.
        *arguments : str
            Its arguments.
        text : str
            Its standard input.
        environment : mapping, optional
            Its environment; default: that in which libraries were loaded.
        folder : Path, optional
            Where it runs; default: the folder of the tests.
        places : tuple of Path
            Folders before all others in which it looks for modules.
        """
        with tempfile.TemporaryDirectory() as streams:
            files = {name: Path(streams, name) for name in ("stdin", "stdout", "stderr")}
            for name, file in files.items():
                file.write_text(text if name == "stdin" else "")
            asked = {
                "code": code,
                "arguments": arguments,
                "environment": dict(self._environment if environment is None else environment),
                "folder": str(folder or Path.cwd()),
                "places": [str(place) for place in places],
                **{name: str(file) for name, file in files.items()},
            }
            assert self._process.stdin is not None
            assert self._process.stdout is not None
            self._process.stdin.write(json.dumps(asked) + "\n")
            self._process.stdin.flush()
            ended = self._process.stdout.readline()
            assert ended, "the process that was to be forked has ended"
            return subprocess.CompletedProcess(
                (code, *arguments), int(ended), files["stdout"].read_text(),
                files["stderr"].read_text(),
            )  # fmt: skip

    def close(self) -> None:
        """End the process, and a fork of it that still runs."""
        os.killpg(self._process.pid, signal.SIGKILL)
        with self._process:
            pass
