"""Modal equations of a structure, without contacts and with constrained coordinates held fixed.

Nothing here depends on where walls are, apart from the place at which coordinates are held: it is
computed once for all systems that differ in their walls.
"""

from __future__ import annotations

import math
import weakref
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy.linalg
import scipy.sparse

from vibroimpact_solvers import condensation
from vibroimpact_solvers.arrays import Booleans, Floats
from vibroimpact_solvers.body import Body
from vibroimpact_solvers.kernels.deviations import SAFETY
from vibroimpact_solvers.matrices import Form, SymmetricMatrix
from vibroimpact_solvers.model import System
from vibroimpact_solvers.spectrum import Spectrum
from vibroimpact_solvers.time_history import modal_damping
from vibroimpact_solvers.time_history.basis import Modes
from vibroimpact_solvers.time_history.loads import (
    SLOW_TURN,
    HarmonicLoads,
    Load,
    Ramps,
    constant,
)
from vibroimpact_solvers.time_history.modal_damping import ModalDamping

_EPS: Final = float(np.finfo(np.float64).eps)
_UNLOADED: Final[weakref.WeakKeyDictionary[Body, tuple[Spectrum, Modes]]] = (
    weakref.WeakKeyDictionary()
)
_TERMS: Final = 100_000  # that are in memory at once


@dataclass(frozen=True, eq=False, slots=True)
class Forces:
    """The loads of a motion.

    Parameters
    ----------
    constant : array, shape (dof,)
        Constant load.
    harmonic : HarmonicLoads
    slow : array of bool, shape (load,)
        Harmonic loads that turn by less than a radian until the end.
    ramps : Ramps
    """

    constant: Floats
    harmonic: HarmonicLoads
    slow: Booleans
    ramps: Ramps

    @classmethod
    def of(cls, system: System, load: tuple[Load, ...], t_end: float) -> Forces:
        """Collect the loads of a system until the end of a motion."""
        harmonic = HarmonicLoads.of(load, system.n)
        force = constant(load, system.n)
        if system.force is not None:
            force = force + system.force
        return cls(
            force, harmonic, harmonic.frequencies * t_end < SLOW_TURN, Ramps.of(load, system.n)
        )


def without_contacts(system: System, forces: Forces, natural: Spectrum) -> Modes:
    """Return the modal equations of the structure that no limiter touches.

    What does not depend on the loads is computed once for all of them.
    """
    known = _UNLOADED.get(system.body)
    if known is None or known[0] is not natural:
        known = _UNLOADED[system.body] = natural, _free(system, natural)
    return _loaded(known[1], forces)


def _free(system: System, natural: Spectrum) -> Modes:
    """Return the modal equations of the structure that no limiter touches, without loads."""
    shapes = natural.modes
    weighted = system.M @ shapes
    rests = np.zeros(natural.roots.size) if natural.rounding is None else natural.rounding
    rounded = natural.norms + (_EPS if natural.rounding is None else 0.0)
    errors = natural.uncertainty if natural.errors is None else natural.errors
    errors = errors + rounded * np.abs(natural.eigenvalues)
    shape_error = natural.norms
    if natural.angles is not None:
        shape_error += float(natural.angles.max(initial=0.0))
    rigid = natural.roots == 0.0
    errors[rigid] = _left_by_rounding(system.K, shapes[:, rigid])
    return _equations(
        system, natural.roots, rests, shapes, weighted, errors, shape_error,
        exact=natural.proved,
    )  # fmt: skip


def with_contacts(system: System, forces: Forces, W: Floats) -> Modes:
    """Return the modal equations with the coordinates of the rows of W held fixed, at zero."""
    M, K = system.M.to_dense(), system.K.to_dense()
    Z: Floats
    if system.massless.size:
        condensed = condensation.of(system)
        Z = condensed.whole(scipy.linalg.null_space(W[:, condensed.massive]))
    else:
        Z = scipy.linalg.null_space(W)
    eigenvalues, vectors = scipy.linalg.eigh(Z.T @ K @ Z, Z.T @ M @ Z)
    shapes = Z @ vectors
    # Terms may be larger than their sums: of a rigid body that nothing else is left of, and of
    # what has no mass.
    magnitudes = np.abs(shapes)
    terms = (magnitudes * (np.abs(K) @ magnitudes)).sum(axis=0)
    scale = float(np.maximum(np.abs(eigenvalues), terms).max(initial=0.0))
    rounding = max(16.0, math.sqrt(system.n)) * _EPS * scale
    eigenvalues[np.abs(eigenvalues) <= rounding] = 0.0
    roots = np.sign(eigenvalues) * np.sqrt(np.abs(eigenvalues))
    errors = np.full(roots.size, rounding / SAFETY)
    weighted = system.M @ shapes
    rests = np.zeros(roots.size)
    return _loaded(_equations(system, roots, rests, shapes, weighted, errors, _EPS), forces)


def placed(modes: Modes, system: System, forces: Forces, base: Floats) -> Modes:
    """Return modal equations whose coordinates are zero at other displacements, shape (dof,).

    These are orthogonal to the modes in M, and so have no part in the inertia.
    """
    force = forces.constant - (system.K @ base if base.any() else 0.0)
    return replace(modes, load=_load(force, modes.shapes), base=base)


def _equations(
    system: System,
    roots: Floats,
    rests: Floats,
    shapes: Floats,
    weighted: Floats,
    errors: Floats,
    shape_error: float,
    *,
    exact: bool = False,
) -> Modes:
    """Return modal equations without loads, of exact modes erring by their entries alone."""
    damped = ModalDamping(None, np.zeros(roots.size), np.zeros((0, 0)))
    if system.C is not None:
        shapes = _with_separate_rigid_modes(system.C, roots, shapes)
        rigid = roots == 0.0
        errors[rigid] = errors[rigid].sum()  # each of them may be any of those before
        weighted = system.M @ shapes
        damped = modal_damping.of_modes(system, shapes, roots, exact=exact)
    none, without = np.zeros(0), np.zeros((roots.size, 0))
    return Modes(
        roots, rests, damped.matrix, np.zeros(roots.size), none, np.zeros(0, dtype=np.bool_),
        without, without, without, none, shapes, np.zeros(system.n), weighted, errors,
        damped.errors, shape_error + damped.neglected, damped.neglected, damped.left_out,
    )  # fmt: skip


def _loaded(modes: Modes, forces: Forces) -> Modes:
    """Return modal equations with loads; what was prepared without them is shared."""
    harmonic, ramps, to_modes = forces.harmonic, forces.ramps, modes.shapes.T
    begin = ramps.segment(0.0) if ramps.count else 0
    return replace(
        modes,
        load=_load(forces.constant, modes.shapes),
        frequencies=harmonic.frequencies,
        slow=forces.slow,
        cosine=to_modes @ harmonic.cosine,
        sine=to_modes @ harmonic.sine,
        ramps=to_modes @ ramps.directions,
        ramp_start=ramps.state(begin, 0.0),
    )


def _load(force: Floats, shapes: Floats) -> Floats:
    """Return the constant load of each mode, shape (mode,).

    One that is only rounding must not drive a rigid-body mode away.
    """
    load: Floats = force @ shapes
    load[np.abs(load) <= 1e-13 * (np.abs(force) @ np.abs(shapes))] = 0.0
    return load


def _with_separate_rigid_modes(C: SymmetricMatrix, roots: Floats, shapes: Floats) -> Floats:
    """Return the modes, those of rigid bodies chosen such that damping does not couple them."""
    rigid = np.flatnonzero(roots == 0.0)
    if rigid.size < 2:
        return shapes
    some = shapes[:, rigid]
    _, turned = np.linalg.eigh(some.T @ (C @ some))
    shapes = shapes.copy()
    shapes[:, rigid] = some @ turned
    return shapes


def _left_by_rounding(K: SymmetricMatrix, rigid: Floats) -> Floats:
    """Return the eigenvalues of rigid-body modes, shape (mode,): K is singular up to rounding."""
    if rigid.shape[1] == 0:
        return np.zeros(0)
    matrix = K.to_dense() if K.form is Form.DENSE else K.to_sparse()
    wide, left = rigid.astype(np.longdouble), np.zeros(rigid.shape[1], np.longdouble)
    rows = max(1, _TERMS * K.n // max(1, matrix.size))
    for begin in range(0, K.n, rows):
        part = scipy.sparse.coo_array(matrix[begin : begin + rows])
        terms = part.data[:, np.newaxis] * wide[begin + part.row] * wide[part.col]
        left += terms.sum(axis=0)
    return np.asarray(np.abs(left), dtype=np.float64)
