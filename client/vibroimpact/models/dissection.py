"""Nested dissection: an order of elimination that leaves few entries in a triangular factor.

A. George, Nested dissection of a regular finite element mesh, SIAM J. Numer. Anal. 10 (1973): a
part is cut in two halves by a separator, which is eliminated behind both; and so is each half.
Nodes are cut along the direction in which a part is longest, by their coordinates or, where these
are not known, by their distances from a few nodes along edges. The separator is the smallest set
of nodes that meets all edges across the cut (Koenig's theorem).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import scipy.sparse as sparse
from scipy.sparse import csgraph

from vibroimpact.tables import Array

_LEAF: Final = 8
"""Nodes of a part that is not cut further: more make factors larger, fewer make them slower."""
_LANDMARKS: Final = 8
_SMOOTHINGS: Final = 20
"""Averages over neighbours that distances take: without them, cuts follow the steps of edges."""


@dataclass(frozen=True, eq=False)
class Parts:
    """Parts of a matrix, each behind those it is cut into.

    Parameters
    ----------
    rows : list of array of int
        Rows of each part: of a separator, or of what is not cut further.
    children : list of list of int
        The parts that each is the separator of.
    """

    rows: list[Any]
    children: list[list[int]]


def parts(A: Any, places: Array | None) -> Parts:
    """Return the parts of a symmetric matrix in the order in which they are eliminated.

    Parameters
    ----------
    A : sparse matrix, shape (n, n)
    places : array, shape (n, dimension), optional
        Where each row lies; default: by the graph of A.
    """
    if A.shape[0] == 0:  # all degrees of freedom are kept
        return Parts([], [])
    node_of, graph = _graph(A)
    if places is None:
        at = _distances(graph)
    else:
        at = np.zeros((graph.shape[0], places.shape[1]))
        at[node_of] = places
    order = np.argsort(node_of, kind="stable")
    starts = np.concatenate([[0], np.cumsum(np.bincount(node_of, minlength=graph.shape[0]))])
    tree = Parts([], [])
    _cut(tree, graph, at, np.arange(graph.shape[0]))
    none = np.zeros(0, dtype=np.int64)
    rows = [
        np.concatenate([none, *(order[starts[node] : starts[node + 1]] for node in nodes)])
        for nodes in tree.rows
    ]
    return Parts(rows, tree.children)


def _graph(A: Any) -> tuple[Any, Any]:
    """Return the node of each row, and which nodes are neighbours; rows of a node look alike."""
    n = A.shape[0]
    entries = sparse.coo_array(A)
    kept = entries.row != entries.col
    row, column = entries.row[kept], entries.col[kept]
    marks = np.random.default_rng(0).integers(1, 2**62, n)
    # The sum of the marks of a row's neighbours and its own tells rows apart, modulo 2^64.
    pattern = sparse.csr_array((np.ones(row.size, dtype=np.int64), (row, column)), shape=(n, n))
    pattern.data[:] = 1
    _, node_of = np.unique(pattern @ marks + marks, return_inverse=True)
    count = int(node_of.max(initial=-1)) + 1
    ends = node_of[row], node_of[column]
    graph: Any = sparse.csr_array((np.ones(row.size), ends), shape=(count, count))
    graph.setdiag(0.0)
    graph.eliminate_zeros()
    graph.data[:] = 1.0
    return node_of, graph


def _distances(graph: Any) -> Array:
    """Return distances along edges from nodes that are far apart, smoothed: as coordinates."""
    n = graph.shape[0]
    _, component = csgraph.connected_components(graph, directed=False)
    columns, nearest, start = [component * float(n)], np.full(n, np.inf), 0
    for count in range(_LANDMARKS + 1):
        depth = _depths(graph, start)
        if count:  # the first one only finds an end
            columns.append(depth)
            nearest = np.minimum(nearest, depth)
        start = int(np.argmax(nearest if count else depth))
    places = np.column_stack(columns)
    weights = 1.0 / np.maximum(np.asarray(graph.sum(axis=1)).reshape(-1, 1), 1.0)
    for _ in range(_SMOOTHINGS):
        places = 0.5 * places + 0.5 * weights * (graph @ places)
    return places


def _depths(graph: Any, start: int) -> Array:
    """Return the number of edges from a node to each; 0 where it is not reached."""
    _, before = csgraph.breadth_first_order(graph, start, directed=False)
    ancestor = np.where(before < 0, np.arange(before.size), before)
    depth = (before >= 0).astype(np.float64)
    while True:
        further = ancestor[ancestor]
        if (further == ancestor).all():
            return depth
        depth, ancestor = depth + depth[ancestor], further


def _cut(tree: Parts, graph: Any, places: Array, nodes: Any) -> int:
    """Add a part and those that it is cut into; return its number."""
    children, own = list[int](), nodes
    if nodes.size > _LEAF:
        inner = graph[nodes][:, nodes]
        moved = places[nodes] - places[nodes].mean(axis=0)
        _, axes = np.linalg.eigh(moved.T @ moved)
        first = np.zeros(nodes.size, dtype=bool)
        first[np.argsort(moved @ axes[:, -1], kind="stable")[: nodes.size // 2]] = True
        separator = _separator(inner, first)
        for half in (first & ~separator, ~first & ~separator):
            if half.any():
                children.append(_cut(tree, graph, places, nodes[half]))
        own = nodes[separator]
    tree.rows.append(own)
    tree.children.append(children)
    return len(tree.rows) - 1


def _separator(graph: Any, first: Any) -> Any:
    """Return the fewest nodes that meet all edges between the first half and the other one."""
    across = sparse.csr_array(graph[first][:, ~first])
    back = sparse.csr_array(across.T)
    partner = csgraph.maximum_bipartite_matching(across, perm_type="column")
    matched = partner >= 0
    partner_of = np.full(across.shape[1], -1)
    partner_of[partner[matched]] = np.flatnonzero(matched)
    at_cut = np.diff(across.indptr) > 0
    # What alternating paths from nodes without a partner reach.
    reached, reached_back = at_cut & ~matched, np.zeros(across.shape[1], dtype=bool)
    new = reached.copy()
    while new.any():
        following = (back @ new.astype(np.float64) > 0.0) & ~reached_back
        reached_back |= following
        rows = partner_of[following]
        new = np.zeros_like(reached)
        new[rows[rows >= 0]] = True
        new &= ~reached
        reached |= new
    separator = np.zeros(first.size, dtype=bool)
    separator[np.flatnonzero(first)[at_cut & ~reached]] = True
    separator[np.flatnonzero(~first)[reached_back]] = True
    return separator
