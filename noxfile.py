"""Every step of the continuous integration, one nox entry each.

``nox -s lint`` makes its own environment; ``nox --no-venv -s lint`` uses the one at hand.
"""

from __future__ import annotations

import pathlib
import shutil
import sys

import nox
from nox.virtualenv import PassthroughEnv

nox.options.default_venv_backend = "venv"
nox.options.reuse_existing_virtualenvs = True
nox.options.sessions = ["lint", "types", "contracts", "openapi", "docs", "tests"]

ROOT = pathlib.Path(__file__).parent


def install(session: nox.Session, *packages: str) -> None:
    """Install into the session's own environment, where it has one."""
    if not isinstance(session.virtualenv, PassthroughEnv):
        session.install(*packages)


@nox.session
def lint(session: nox.Session) -> None:
    """Check the style of the sources: ruff's rules and its formatting."""
    install(session, "-e", ".[dev]")
    session.run("ruff", "check", ".")
    session.run("ruff", "format", "--check", ".")


@nox.session
def types(session: nox.Session) -> None:
    """Check the strict types of the four packages."""
    install(session, "-e", ".[dev]")
    session.run("mypy")


@nox.session
def contracts(session: nox.Session) -> None:
    """Check that imports point one way and nothing reaches past the use case."""
    install(session, "-e", ".[dev]")
    session.run("lint-imports")


@nox.session
def openapi(session: nox.Session) -> None:
    """Check that the committed contract is the one that the service speaks."""
    install(session, "-e", ".[dev]")
    session.run("python", "-m", "vibroimpact_service.cli", "openapi", "--check")


@nox.session
def docs(session: nox.Session) -> None:
    """Build the documentation site, warnings as errors."""
    install(session, "-e", ".[dev]")
    session.run("mkdocs", "build", "--strict", "--clean", env={"NO_MKDOCS_2_WARNING": "1"})


@nox.session
def tests(session: nox.Session) -> None:
    """Run the whole test suite."""
    install(session, "-e", ".[test]")
    session.run("pytest", *session.posargs)


@nox.session
def fuzz(session: nox.Session) -> None:
    """Send schemathesis' requests to a service: no 5xx, nothing but what the contract says.

    More than 20,000 cases, all checks, two users: two minutes of two cores.
    ``nox -s fuzz -- --cases 50000 --examples 400 --seed 7`` for a night.
    """
    install(session, "-e", ".[fuzz]")
    session.run("python", "tests/fuzz/conformance.py", *session.posargs)


@nox.session
def truth(session: nox.Session) -> None:
    """Compare random cases with references of more digits that share no formula with the solvers.

    Hours. ``nox -s truth -- impact-modes histories --count 2000 --seed 7 --jobs 2`` for a part;
    ``--folder FOLDER`` keeps what was done, to go on later; ``--show INDEX`` prints and checks one
    case, ``--case FILE`` one that was printed.
    """
    install(session, "-e", ".[test]")
    session.run("python", "-m", "tests.truth", *session.posargs)


@nox.session
def browser(session: nox.Session) -> None:
    """Look at the pages of the service in a real Chromium (Debian: apt install chromium)."""
    install(session, "-e", ".[browser]")
    session.run("pytest", "-n", "0", "tests/browser", *session.posargs)


@nox.session
def guard(session: nox.Session) -> None:
    """Count the instructions of the watched kernels: none may need 3 % more than usual.

    It needs valgrind. ``nox -s guard -- --usual`` stores the counts as the usual ones,
    ``nox -s guard -- --against CHECKOUT`` counts the kernels of another checkout beside.
    """
    if not shutil.which("valgrind"):
        session.error("valgrind is not installed: apt install valgrind (see CONTRIBUTING.md)")
    install(session, "-e", ".[test]")
    session.run("python", "-m", "benchmarks.guard", *session.posargs)
    session.run("pytest", "-n", "0", "-m", "valgrind", "tests/benchmarks/test_guard.py")


@nox.session
def benchmarks(session: nox.Session) -> None:
    """Run all benchmarks with all peers, store the results and draw the pages of the docs."""
    install(session, "-e", ".[bench]")
    session.run("vibroimpact", "bench", *session.posargs, "--save")


@nox.session
def faults(session: nox.Session) -> None:
    """Kill processes at random moments, fill disks, cut networks; all jobs must end well."""
    install(session, "-e", ".[test]")
    session.run(
        "pytest", "-n", "0", "-m", "faults", "-s", "tests/acceptance/faults", *session.posargs
    )


@nox.session(venv_backend="none")
def client_alone(session: nox.Session) -> None:
    """Install the client in a clean environment: no solver or server library comes with it."""
    place = pathlib.Path(session.create_tmp()) / "client"
    shutil.rmtree(place, ignore_errors=True)
    session.run(sys.executable, "-m", "venv", str(place), external=True)
    python = str(place / "bin" / "python")
    session.run(python, "-m", "pip", "install", "-q", f"{ROOT}[client]", external=True)
    check = (
        "import importlib.util as u, sys, vibroimpact, vibroimpact.cli\n"
        "there = [n for n in ('numba', 'scipy', 'fastapi', 'distributed', 'sqlalchemy')"
        " if u.find_spec(n)]\n"
        "sys.exit(f'the client brings {there}' if there else 0)\n"
    )
    session.run(python, "-c", check, external=True)
    session.run(str(place / "bin" / "vibroimpact"), "--help", external=True)
