"""The command line: ``vibroimpact compute``, jobs and results; commands of the service beside."""

from __future__ import annotations

import sys


def main() -> None:
    """Run the command line, or say what it needs."""
    try:
        from vibroimpact.cli import app
    except ImportError as error:
        if error.name not in ("typer", "click"):
            raise
        sys.exit("The command line needs:  pip install 'vibroimpact[cli]'")
    app.run()
