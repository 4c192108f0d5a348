"""What a test needs beside Python, as its source says: processes, a server, the compiler.

Read without importing anything: from a test, the functions and variables that it uses are
followed through its file, the fixtures of its folders and other modules of the tests, down to the
modules of `MODULES`. What a test reaches through the project's own code is not seen here; there
`tests.quick` stops it.
"""

from __future__ import annotations

import ast
import functools
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple, TypeGuard

ROOT: Final = Path(__file__).parent.parent

COMPILER: Final = "the compiler"
COMPILED: Final = "compiled kernels"
PROCESSES: Final = "processes"
SERVER: Final = "a server"
DATABASE: Final = "PostgreSQL"
KNOWN: Final = {
    COMPILER: "looks at what is compiled",
    COMPILED: "would take long where kernels are plain Python",
    PROCESSES: "starts processes",
    SERVER: "opens a port",
    DATABASE: "starts a database",
}
"""What may be needed, and what a test does that needs it."""
MODULES: Final = {
    "distributed": PROCESSES,
    "http.server": SERVER,
    "llvmlite": COMPILER,
    "moto": SERVER,
    "multiprocessing": PROCESSES,
    "numba": COMPILER,
    "psycopg": DATABASE,
    "socketserver": SERVER,
    "subprocess": PROCESSES,
    "uvicorn": SERVER,
    "vibroimpact_service.jobs.forkserver": PROCESSES,
    "vibroimpact_service.jobs.queue.JobQueue": PROCESSES,
    "vibroimpact_service.jobs.engine.Engine": PROCESSES,
}
"""Modules that give a test what it needs."""
ROOMS: Final = {
    "acceptance": PROCESSES,
    "solvers/attractors": COMPILED,
    "solvers/branches": COMPILED,
    "solvers/existence_bands": COMPILED,
    "solvers/periodic_motions": COMPILED,
    "solvers/stress": COMPILED,
}
"""Folders whose tests need something unless they are marked quick: programs as users start them,
and computations that are long."""

Function = ast.FunctionDef | ast.AsyncFunctionDef


class Imported(NamedTuple):
    """A name that an import statement binds: a module, or something in it."""

    module: str
    name: str | None


class Uses(NamedTuple):
    """What a statement refers to: names of its file, arguments that may be fixtures, imports."""

    names: frozenset[str]
    fixtures: frozenset[str]
    imports: frozenset[Imported]


class Module:
    """A file of the tests: what its names stand for."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.text = path.read_text(encoding="utf-8")
        self.tree = ast.parse(self.text)
        self.names: dict[str, list[ast.AST | Imported]] = {}
        for node in self.tree.body:
            for name, meaning in _bound(node):
                self.names.setdefault(name, []).append(meaning)

    def tests(self) -> Iterator[ast.AST]:
        """Yield the tests, and the classes that contain tests."""
        for node in self.tree.body:
            kind = {Function: "test", ast.ClassDef: "Test"}
            if any(isinstance(node, each) and node.name.startswith(kind[each]) for each in kind):
                yield node

    def of_name(self, name: str, seen: set[tuple[Path, str]]) -> set[str]:
        """Return what is needed by whatever a name stands for; `seen` was or is looked at."""
        if (self.path, name) in seen:
            return set()
        seen.add((self.path, name))
        found: set[str] = set()
        for meaning in self.names.get(name, []):
            if isinstance(meaning, Imported):
                found |= _of_import(meaning, seen)
            else:
                found |= self.of_node(meaning, seen)
        return found

    def of_node(self, node: ast.AST, seen: set[tuple[Path, str]]) -> set[str]:
        """Return what is needed by a statement."""
        uses = _uses(node)
        found = {need for each in uses.imports for need in _of_import(each, seen)}
        for name in uses.names:
            found |= self.of_name(name, seen)
        for name in uses.fixtures:
            module = self._with_fixture(name)
            found |= module.of_name(name, seen) if module else set()
        return found

    @functools.cache  # noqa: B019 - modules are kept anyway
    def _with_fixture(self, name: str) -> Module | None:
        """Return the file that may define a fixture: this one, or one of the folders around it."""
        if name in self.names:
            return self
        for folder in self.path.parents:
            file = folder / "conftest.py"
            if file.exists() and name in _module(file).names:
                return _module(file)
            if folder == ROOT:
                break
        return None


@functools.cache
def of_test(path: Path, *names: str) -> frozenset[str]:
    """Return what a test needs.

    Parameters
    ----------
    path : Path
        Its file.
    *names : str
        Its name; before it that of its class, if it is in one.
    """
    module, seen = _module(path), set[tuple[Path, str]]()
    found = _of_room(path)
    if len(names) == 1:
        return frozenset(found | module.of_name(names[0], seen))
    for node in module.names.get(names[0], []):
        for each in node.body if isinstance(node, ast.ClassDef) else []:
            other = isinstance(each, Function) and each.name.startswith("test")
            if not other or each.name == names[-1]:
                found |= module.of_node(each, seen)
    return frozenset(found)


def tests_of(path: Path) -> Iterator[tuple[str, ...]]:
    """Yield the names of the tests of a file, as `of_test` takes them."""
    for node in _module(path).tests():
        if isinstance(node, Function):
            yield (node.name,)
        elif isinstance(node, ast.ClassDef):
            inside = (each for each in node.body if isinstance(each, Function))
            yield from ((node.name, each.name) for each in inside if each.name.startswith("test"))


def of_whole_file(path: Path) -> set[str]:
    """Return what the tests of a file need, each something; nothing if one needs nothing."""
    module = _module(path)
    if "mark.quick" in module.text:
        return set()
    found = set(_marks(*(each for each in module.names.get("pytestmark", []) if _is_node(each))))
    if found:
        return found
    for names in tests_of(path):
        marks = _marks(*(each for each in module.names[names[0]] if _is_node(each)))
        needed = of_test(path, *names) | set(marks)
        if not needed:
            return set()
        found |= needed
    return found


def _of_room(path: Path) -> set[str]:
    """Return what the tests of a folder need."""
    return {need for room, need in ROOMS.items() if ROOT / "tests" / room in path.parents}


@functools.cache
def _module(path: Path) -> Module:
    return Module(path)


def _is_node(meaning: ast.AST | Imported) -> TypeGuard[ast.AST]:
    return isinstance(meaning, ast.AST)


@functools.cache
def _uses(node: ast.AST) -> Uses:
    names, fixtures, imports = set[str](), set[str](), set[Imported]()
    for each in ast.walk(node):
        if isinstance(each, ast.Import | ast.ImportFrom):
            imports |= {meaning for _, meaning in _bound(each) if isinstance(meaning, Imported)}
        elif isinstance(each, ast.Name):
            names.add(each.id)
        elif isinstance(each, Function):
            fixtures |= {argument.arg for argument in (*each.args.args, *each.args.kwonlyargs)}
            fixtures |= set(_calls("usefixtures", *each.decorator_list))
    return Uses(frozenset(names), frozenset(fixtures), frozenset(imports))


def _bound(node: ast.AST) -> Iterator[tuple[str, ast.AST | Imported]]:
    """Yield the names that a statement binds in its module, and what they stand for."""
    if isinstance(node, ast.Import):
        for alias in node.names:
            yield alias.asname or alias.name.partition(".")[0], Imported(alias.name, None)
    elif isinstance(node, ast.ImportFrom):
        for alias in node.names:
            yield alias.asname or alias.name, Imported(node.module or "", alias.name)
    elif isinstance(node, Function | ast.ClassDef):
        yield node.name, node
    elif isinstance(node, ast.If | ast.Try | ast.With | ast.For):
        for part in ast.iter_child_nodes(node):
            yield from _bound(part)
    elif isinstance(node, ast.Assign | ast.AnnAssign):
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        for target in targets:
            for name in ast.walk(target):
                if isinstance(name, ast.Name):
                    yield name.id, node


def _of_import(imported: Imported, seen: set[tuple[Path, str]]) -> set[str]:
    whole = imported.module if imported.name is None else f"{imported.module}.{imported.name}"
    parts = whole.split(".")
    for end in range(1, len(parts) + 1):
        need = MODULES.get(".".join(parts[:end]))
        if need is not None:
            return {need}
    if parts[0] != "tests":
        return set()
    file = ROOT.joinpath(*parts).with_suffix(".py")
    if file.exists():  # a module: any of it may be used
        module = _module(file)
        return {need for name in module.names for need in module.of_name(name, seen)}
    file = ROOT.joinpath(*parts[:-1]).with_suffix(".py")
    return _module(file).of_name(parts[-1], seen) if file.exists() else set()


def _calls(name: str, *nodes: ast.AST) -> Iterator[str]:
    """Yield the strings that are given to calls of a mark."""
    for node in nodes:
        for call in ast.walk(node):
            if isinstance(call, ast.Call) and ast.unparse(call.func).endswith(f"mark.{name}"):
                for given in call.args:
                    if isinstance(given, ast.Constant):
                        yield str(given.value)


def _marks(*nodes: ast.AST) -> Iterator[str]:
    yield from (need for need in _calls("needs", *nodes) if need in KNOWN)
