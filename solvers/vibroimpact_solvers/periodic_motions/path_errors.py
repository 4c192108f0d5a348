"""Errors of forms on the state anywhere along solutions."""

from __future__ import annotations

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.periodic_motions.drive import Driven
from vibroimpact_solvers.periodic_motions.solutions import Cells, Solutions


def along_paths(driven: Driven, cells: Cells, solved: Solutions, forms: Floats) -> Floats:
    """Return the errors of forms (form, 2, pair) anywhere along solutions, (solution, form)."""
    pairs, sizes, shape = driven.pairs, _flat(np.abs(forms)), 2.0 * driven.shape_error
    length, count = solved.length.max(axis=1), solved.index.size
    # Until a vibration has decayed its phase is off by that of its rate and of the time.
    lasts = 1.0 / np.maximum(-pairs.growth, 1.0 / length[:, np.newaxis])
    late = (2.0 * pairs.drift + EPS * pairs.speed) * np.minimum(length[:, np.newaxis], lasts)
    inexact = solved.whole_error + shape + 4.0 * EPS + late
    moved = pairs.size(solved.state) * inexact[:, np.newaxis, np.newaxis]
    error: Floats = (_flat(moved) @ sizes.T).max(axis=1)
    by_load, moduli = steady_errors(driven, cells, forms), np.abs(cells.steady)
    error += by_load.sum(axis=1)[solved.index]
    if driven.mixing and solved.state_floor.size:
        states = np.abs(solved.state).sum(axis=2).max(axis=1)
        error += states @ driven.mixing.of_forms(forms).T
        error += solved.state_floor @ np.abs(forms).sum(axis=1).T
    moves = (_flat(moduli) @ sizes.T * driven.harmonics[:, np.newaxis]).sum(axis=1)
    starts = np.abs(solved.phase).max(axis=1, initial=0.0)
    rounded = EPS * (starts + cells.Omega[solved.index] * length)
    late_by = solved.phase_error.max(axis=1, initial=0.0) + rounded
    error += moves[solved.index] * late_by[:, np.newaxis]
    assert error.shape == (count, len(forms))
    return error


def steady_errors(driven: Driven, cells: Cells, forms: Floats) -> Floats:
    """Return the errors of forms of the steady responses, shape (frequency, harmonic, form)."""
    moduli, sizes = np.abs(cells.steady), np.abs(forms)
    inexact = cells.steady_error + 2.0 * driven.shape_error + 4.0 * EPS
    error = _flat(moduli * inexact[:, :, np.newaxis]) @ _flat(sizes).T
    if driven.mixing:
        error += moduli.sum(axis=2) @ driven.mixing.of_forms(forms).T
        error += cells.steady_floor(driven) @ sizes.sum(axis=1).T
    return np.asarray(error)


def _flat(states: Floats) -> Floats:
    """Return states or forms (…, 2, pair) as rows."""
    return np.asarray(states.reshape(*states.shape[:-2], 2 * states.shape[-1]))
