"""``python -m vibroimpact_service`` serves."""

import typer

from vibroimpact_service.cli import serve

if __name__ == "__main__":
    typer.run(serve)
