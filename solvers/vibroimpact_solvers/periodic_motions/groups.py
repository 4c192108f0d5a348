"""Modes of equal natural frequencies, turned so that as few as can be take part in impacts.

Any orthonormal vectors of the space that equal frequencies share are modes. Where damping tells
them apart, those are taken that it does not couple to one another. Of the others, with one struck
coordinate, one vector has the whole participation and the rest none: they are silent, vibrate as
if there were no stops, and their multipliers are those of the structure by itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from vibroimpact_solvers.arrays import EPS, Booleans, Floats, Integers
from vibroimpact_solvers.time_history import modal_damping
from vibroimpact_solvers.time_history.basis import Modes
from vibroimpact_solvers.time_history.modal_damping import ModalDamping
from vibroimpact_solvers.time_history.structure import Structure

_EQUAL: Final = 1e-12  # relative distance of eigenvalues that may be equal, their errors apart
_ALIKE: Final = 1e-22  # relative distance of eigenvalues that are the same to twice the digits
_ROUNDED: Final = 32.0 * EPS  # of a row's length, what rounding leaves of no participation


class Turned(NamedTuple):
    """Modes of a structure, those of equal frequencies turned."""

    modes: Modes
    silent: Booleans  # where a mode has a node at a constraint, (constraint, mode)
    groups: list[Integers]  # places of modes of equal frequencies
    spread: Floats  # error of the stiffness that couples those of each group, (group,)


def turned(structure: Structure, modes: Modes) -> Turned:
    """Return modes with those of equal frequencies turned.

    Parameters
    ----------
    structure : Structure
    modes : Modes
        Without harmonic and sampled loads.
    """
    silent = structure.natural.participations(structure.system.constraints)[0] == 0.0
    groups, count = list(_groups(modes)), modes.roots.size
    if not groups:
        return Turned(modes, silent, groups, np.zeros(0))
    spread = []
    C, shapes = structure.system.C, modes.shapes.copy()
    lambdas, errors = _eigenvalues(modes), modes.errors.copy()
    dragged = np.zeros(shapes.shape) if C is None else C @ shapes
    lengths = np.abs(structure.W).sum(axis=1)[:, np.newaxis] * np.abs(shapes).max()
    for group in groups:
        space = shapes[:, group]
        if C is not None:
            space = space @ np.linalg.eigh(space.T @ dragged[:, group])[1]
        for part in _alike(structure, space):
            rows = structure.W @ space[:, part] / lengths
            if C is not None:  # what damping couples to others is not silent
                others = np.setdiff1d(np.arange(count), group)
                drag = shapes[:, others].T @ (C @ space[:, part])
                largest = float(np.abs(C.data).max(initial=0.0) * np.abs(shapes).max() ** 2)
                rows = np.concatenate([rows, drag / (largest or 1.0)])
            small = np.linalg.qr(rows, mode="r")
            space[:, part] = space[:, part] @ np.linalg.svd(small)[2].T
        shapes[:, group] = space
        rows = structure.W @ space
        silent[:, group] = np.abs(rows) <= _ROUNDED * group.size * lengths
        mean = lambdas[group].mean()
        apart = float(np.abs(lambdas[group] - mean).max())
        apart = apart if apart > _ALIKE * abs(float(mean)) else 0.0
        spread.append(apart)
        errors[group] = errors[group].max() + apart
        lambdas[group] = mean
    roots, rests = modes.roots.copy(), modes.rests.copy()
    every = np.concatenate(groups)
    exact = np.sign(lambdas[every]) * np.sqrt(np.abs(lambdas[every]))
    roots[every] = exact
    rests[every] = exact / roots[every].astype(np.longdouble) - 1
    system, damped = structure.system, ModalDamping(None, modes.damping_errors, np.zeros((0, 0)))
    if C is not None:
        exact_modes = structure.natural.proved
        damped = modal_damping.of_modes(system, shapes, roots, exact=exact_modes)
        for group in groups:  # rates of equal modes change as much as what is left out
            damped.errors[group] += damped.left_out[np.ix_(group, group)].sum(axis=1)
    load = structure.force @ shapes
    load[np.abs(load) <= 1e-13 * (np.abs(structure.force) @ np.abs(shapes))] = 0.0
    none = np.zeros((count, 0))
    changed = replace(
        modes, roots=roots, rests=rests, damping=damped.matrix, damping_errors=damped.errors,
        load=load, cosine=none, sine=none, ramps=none, shapes=shapes, weighted=system.M @ shapes,
        errors=errors, neglected=damped.neglected, left_out=damped.left_out,
        shape_error=modes.shape_error - modes.neglected + damped.neglected + 4.0 * EPS,
    )  # fmt: skip
    return Turned(changed, silent, groups, np.array(spread))


def _eigenvalues(modes: Modes) -> np.ndarray:
    """Return eigenvalues in the wider type where there is one."""
    roots = modes.roots * (1 + modes.rests.astype(np.longdouble))
    return np.asarray(roots * np.abs(roots))


def _groups(modes: Modes) -> Iterator[Integers]:
    """Yield the places of modes whose frequencies are equal but for their errors."""
    lambdas = _eigenvalues(modes)
    order = np.argsort(lambdas, kind="stable")
    begin = 0
    for end in range(1, order.size + 1):
        first = order[begin]
        size = float(abs(lambdas[first]))
        if end < order.size:
            last = order[end]
            apart = float(lambdas[last] - lambdas[first])
            allowed = modes.errors[first] + modes.errors[last] + 8.0 * EPS * size
            if apart <= min(allowed, _EQUAL * size):
                continue
        if end - begin > 1 and size > 0.0:
            yield np.sort(order[begin:end])
        begin = end


def _alike(structure: Structure, space: Floats) -> Iterator[slice]:
    """Yield the columns of a space that damping does not tell apart, which follow one another."""
    C, count = structure.system.C, space.shape[1]
    if C is None:
        yield slice(0, count)
        return
    damped = modal_damping.of_rounded_modes(C, space)
    assert damped.matrix is not None
    own, errors, begin = damped.matrix.diagonal(), damped.errors, 0
    for end in range(1, count + 1):
        if end < count:
            allowed = 8.0 * (errors[begin] + errors[end]) + _ROUNDED * abs(own[begin])
            if abs(own[end] - own[begin]) <= allowed:
                continue
        if end - begin > 1:
            yield slice(begin, end)
        begin = end
