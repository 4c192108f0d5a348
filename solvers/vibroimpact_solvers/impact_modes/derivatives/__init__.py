"""Derivatives of impact modes by numbers of their problem.

The equations of a family (`kernels.families`) are linear in impulses and modal amplitudes, so that
derivatives solve the same equations with other right-hand sides (`equations`, `elimination`), to
which the natural modes contribute by their own rates (`rates`) and by the slopes of the functions
of time (`functions`).
"""

from vibroimpact_solvers.impact_modes.derivatives.outputs import Derivatives

__all__ = ["Derivatives"]
