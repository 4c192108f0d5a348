"""Whatever is logged, by us or by libraries, is a JSON object per line on stderr."""

from __future__ import annotations

import json
import subprocess
import sys

PROGRAM = """
import logging, structlog
import distributed
from vibroimpact_service import logs
logs.to_stderr()
structlog.get_logger("vibroimpact").info("ours", value=1, path=__import__("pathlib").Path("/x"))
structlog.get_logger("vibroimpact").debug("not said")
logging.getLogger("uvicorn.error").error("theirs, %s", "filled in")
logging.getLogger("distributed.worker").error("of a worker")
logging.getLogger("uvicorn.error").info("not said")
logging.getLogger("distributed.core").info("not said")
try:
    1 / 0
except ZeroDivisionError:
    logging.getLogger("distributed.core").exception("two\\nlines")
try:
    raise distributed.comm.CommClosedError
except distributed.comm.CommClosedError:
    logging.getLogger("distributed.worker").exception("the connection is no longer there")
"""


def test_all_lines_are_json() -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, timeout=120, check=True
    )
    assert done.stdout == ""
    ours, theirs, worker, fault = map(json.loads, done.stderr.splitlines())
    assert (ours["event"], ours["level"], ours["value"], ours["path"]) == ("ours", "info", 1, "/x")
    assert (theirs["event"], theirs["logger"]) == ("theirs, filled in", "uvicorn.error")
    assert (worker["event"], worker["level"]) == ("of a worker", "error")
    assert fault["event"] == "two\nlines"
    assert "ZeroDivisionError" in fault["exception"]
    assert all("timestamp" in line for line in (ours, theirs, worker, fault))
