"""The triangular sine against its definition by the arcsine."""

from __future__ import annotations

import numpy as np

from vibroimpact_solvers.kernels.jit import kernel
from vibroimpact_solvers.kernels.waves import fold


@kernel
def folded(phi: float) -> tuple[float, float]:
    return fold(phi)


def test_triangle_and_square_wave() -> None:
    for phi in np.random.default_rng(1).uniform(-9.0, 9.0, 200):
        tau, e = folded(phi)
        assert abs(tau - 2 / np.pi * np.arcsin(np.sin(np.pi * phi / 2))) < 1e-13
        assert e == np.sign(np.cos(np.pi * phi / 2))


def test_the_wave_turns_at_odd_phases() -> None:
    assert folded(1.0) == (1.0, -1.0)
    assert folded(3.0) == (-1.0, 1.0)
