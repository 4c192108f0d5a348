"""What the code compiled from a module depends on: its syntax, and that of what it imports.

Comments, docstrings, blank lines and line breaks decide nothing. What a module imports from its
own package does, wherever it stands: constants and functions enter the code that is compiled, and
named tuples the places at which it looks for their fields. Imports within functions and those for
the type checker count too: a kernel that imports a named tuple for an annotation reads its fields.

Parsing all modules takes a fifth of a second, which every process would spend. The digests of
syntax trees are therefore kept in a file, by the content of the modules.
"""

from __future__ import annotations

import ast
import contextlib
import functools
import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

_MOST_KEPT: Final = 2000
"""Modules in the file of digests; some 40 belong to one state of the sources."""


class Source(NamedTuple):
    """A module, as far as it matters to what is compiled.

    Attributes
    ----------
    tree : str
        Digest of its syntax tree.
    imports : list of tuple
        Module that an import statement names, as far as it is written without dots in front, and
        the names imported from it. Modules of other packages are left out.
    """

    tree: str
    imports: list[tuple[str, list[str]]]


class Sources:
    """Modules of a package, read once.

    Parameters
    ----------
    package : Path
        Folder of a package, whose name is that of the folder.
    digests : Path, optional
        File in which digests of syntax trees are kept.
    """

    def __init__(self, package: Path, digests: Path | None = None) -> None:
        self._package, self._file = package, digests
        self._kept = _read(digests) if digests else {}
        self._of_content: dict[str, Source] = {}
        self._modules: dict[str, Source | None] = {}
        self._packages: dict[str, bool] = {}

    def fingerprints(self, room: Path) -> dict[str, str]:
        """Return the fingerprints of the modules in a folder of the package, by their names.

        Parameters
        ----------
        room : Path
            The folder.

        Returns
        -------
        dict
            Name such as ``"package.room.module"`` -> 16 hexadecimal digits, which change with
            the syntax of the module and of every module that it imports, directly or not.
        """
        place = ".".join([self._package.name, *room.relative_to(self._package).parts])
        names = [f"{place}.{file.stem}" for file in sorted(room.glob("*.py"))]
        names = [name.removesuffix(".__init__") for name in names]
        fingerprints = {name: self._fingerprint(name) for name in names if self._source(name)}
        self._keep()
        return fingerprints

    def needed(self, name: str) -> set[str]:
        """Return the names of all modules that a module imports, directly or not, and its own."""
        needed: set[str] = set()
        left = [name]
        while left:
            if (each := left.pop()) not in needed:
                needed.add(each)
                left += self._imported(each)
        return needed

    def _fingerprint(self, name: str) -> str:
        digest = hashlib.sha256()
        for each in sorted(self.needed(name)):
            source = self._source(each)
            assert source is not None
            digest.update(f"{each} {source.tree}\n".encode())
        return digest.hexdigest()[:16]

    def _imported(self, name: str) -> Iterator[str]:
        source = self._source(name)
        for module, names in source.imports if source else ():
            parts = module.split(".")
            # Importing a module runs the packages it is in, but only what is imported from them
            # can enter the code.
            yield from (module,) if self._source(module) else ()
            if self._packages.get(".".join(parts)):
                inner = (f"{module}.{each}" for each in names)
                yield from (each for each in inner if self._source(each))

    def _source(self, name: str) -> Source | None:
        """Return a module, None if there is none of this name."""
        if name not in self._modules:
            self._modules[name] = self._found(name)
        return self._modules[name]

    def _found(self, name: str) -> Source | None:
        path = self._package.parent.joinpath(*name.split("."))
        for file in (path / "__init__.py", path.with_name(f"{path.name}.py")):
            with contextlib.suppress(FileNotFoundError, NotADirectoryError):
                content = file.read_bytes()
                self._packages[name] = file.name == "__init__.py"
                return self._parsed(content, name)
        return None

    def _parsed(self, content: bytes, name: str) -> Source:
        # Dots in front of what is imported mean another module in another place.
        place = name if self._packages[name] else name.rpartition(".")[0]
        key = hashlib.sha256(f"{place}\n".encode() + content).hexdigest()
        source = self._kept.get(key) or parse(content, place)
        self._of_content[key] = source
        return source

    def _keep(self) -> None:
        """Keep the digests of what had to be parsed, as far as it is permitted."""
        if self._file is None or self._of_content.keys() <= self._kept.keys():
            return
        kept = {**self._kept, **self._of_content}
        if len(kept) > _MOST_KEPT:
            kept = self._of_content
        passing = self._file.with_name(f".{self._file.name}-{os.getpid()}")
        with contextlib.suppress(OSError):
            passing.write_text(json.dumps({"by": _reader(), "modules": kept}))
            passing.replace(self._file)


def parse(content: bytes, place: str) -> Source:
    """Return what matters of a module.

    Parameters
    ----------
    content : bytes
        Its source.
    place : str
        Name of the package that it is in, or of itself if it is one.
    """
    tree = ast.parse(content)
    imports = list(_imports(tree, place))
    _without_docstrings(tree)
    return Source(hashlib.sha256(ast.dump(tree).encode()).hexdigest(), imports)


def _nodes(tree: ast.AST) -> Iterator[ast.AST]:
    yield tree
    for each in ast.iter_child_nodes(tree):
        yield from _nodes(each)


def _imports(tree: ast.AST, place: str) -> Iterator[tuple[str, list[str]]]:
    """Yield the modules of the same package that are imported, and the names from them."""
    top = place.partition(".")[0]
    for node in _nodes(tree):
        if isinstance(node, ast.Import):
            imported = [(alias.name, list[str]()) for alias in node.names]
            # Of `import a.b`, `a` can be used, too.
            imported += [
                (".".join(parts[:end]), [])
                for alias in node.names
                for parts in [alias.name.split(".")]
                for end in range(1, len(parts))
            ]
        elif isinstance(node, ast.ImportFrom):
            above = place.split(".")[: len(place.split(".")) - node.level + 1] if node.level else []
            module = ".".join([*above, *([node.module] if node.module else [])])
            imported = [(module, [alias.name for alias in node.names])]
        else:
            continue
        yield from (each for each in imported if each[0].partition(".")[0] == top)


def _without_docstrings(tree: ast.AST) -> None:
    """Remove the statements of a tree that are a string and nothing else."""
    for node in _nodes(tree):
        for block in ("body", "orelse", "finalbody"):
            statements = getattr(node, block, None)
            if isinstance(statements, list):
                setattr(node, block, [each for each in statements if not _is_string(each)])


def _is_string(node: ast.AST) -> bool:
    value = node.value if isinstance(node, ast.Expr) else None
    return isinstance(value, ast.Constant) and isinstance(value.value, str)


@functools.cache
def _reader() -> str:
    """Return a digest of this file: another version of it may see other things in a module."""
    return hashlib.sha256(Path(__file__).read_bytes()).hexdigest()


def _read(file: Path) -> Mapping[str, Source]:
    """Return the digests that a file keeps; none if it is damaged, or by another version."""
    try:
        document: Any = json.loads(file.read_text())
        if document["by"] != _reader():
            return {}
        return {key: Source(*value) for key, value in document["modules"].items()}
    except (OSError, ValueError, KeyError, TypeError):
        return {}
