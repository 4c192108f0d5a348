"""Kernels can be read: short functions with few arguments, and state that has names."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from vibroimpact_solvers import kernels

ARGUMENTS, LINES = 9, 100
COMPILERS = {"kernel", "bare", "inner", "inline", "once"}
NUMBERED = {"shape", "strides"}
"""Attributes whose places have a meaning of their own: the axes of an array."""
FIRST = {"sine_cosine", "_evaluate"}
"""Functions that return a pair of which a caller may take one: sine and cosine, value and slope."""
ORDERS = {"d", "low", "b", "c", "f", "g", "_FACTORIALS", "_BERNSTEIN"}
"""Arrays whose places are orders: of derivatives, of coefficients of polynomials."""
RECORDS = {"course", "piece", "progress"}
"""Arrays of one record, in which a kernel writes the fields that are read after it."""

MODULES = sorted(Path(kernels.__file__).parent.glob("*.py"))


def functions(tree: ast.AST) -> Iterator[ast.FunctionDef]:
    """Yield the functions that are compiled."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            names = {name.id for name in node.decorator_list if isinstance(name, ast.Name)}
            if names & COMPILERS:
                yield node


def numbered(function: ast.FunctionDef) -> Iterator[str]:
    """Yield the subscripts of a function that are integers, and mean a place by its number."""
    for node in ast.walk(function):
        if not isinstance(node, ast.Subscript):
            continue
        of = node.value
        called = of.func if isinstance(of, ast.Call) else None
        if isinstance(called, ast.Name) and called.id in FIRST:
            continue
        if ast.unparse(of).rpartition(".")[2] in NUMBERED | RECORDS | ORDERS:
            continue
        places = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        for place in places:
            try:
                value = ast.literal_eval(place)
            except ValueError:
                continue
            if isinstance(value, int):
                yield ast.unparse(node)


@pytest.fixture(params=MODULES, ids=lambda path: path.stem)
def module(request: pytest.FixtureRequest) -> ast.Module:
    path: Path = request.param
    return ast.parse(path.read_text(encoding="utf-8"))


def test_few_arguments(module: ast.Module) -> None:
    for function in functions(module):
        given = function.args
        count = len(given.posonlyargs) + len(given.args) + len(given.kwonlyargs)
        assert count <= ARGUMENTS, function.name


def test_short_functions(module: ast.Module) -> None:
    for function in functions(module):
        assert function.end_lineno is not None
        assert function.end_lineno - function.lineno < LINES, function.name


def test_places_have_names(module: ast.Module) -> None:
    for function in functions(module):
        assert list(numbered(function)) == [], function.name


def test_numbered_places_are_found() -> None:
    """A state by numbers is told from the axes of an array and from computed places."""
    text = """
@kernel
def example(state, A, j):
    a = state[3] + A[j, 0] + state[-1]
    return a + A.shape[0] + state[j] + A[j, j + 1] + sine_cosine(a, 0.0)[1]
"""
    (function,) = functions(ast.parse(text))
    assert sorted(numbered(function)) == ["A[j, 0]", "state[-1]", "state[3]"]
