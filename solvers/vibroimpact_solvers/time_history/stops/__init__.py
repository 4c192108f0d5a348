"""Motions with stops of finite stiffness, exact between the switchings of their stops.

A stop with the force ``max(0, k d + c d')`` for an indentation d > 0 is open, loaded or released
(`vibroimpact_solvers.laws`). While no stop changes its state the structure is linear, and each
change is a zero of a linear form of the state: a coordinate at its wall, or a force. The state is
continuous; with a dashpot the force jumps when the wall is reached. Deviations therefore carry
over unchanged, but for ``dv -= c (w dx) M^-1 w`` at that instant.
"""

from vibroimpact_solvers.time_history.stops.motions import StoppedMotions

__all__ = ["StoppedMotions"]
