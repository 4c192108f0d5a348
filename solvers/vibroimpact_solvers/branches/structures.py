"""The structures at values of the parameter, with stops of finite stiffness."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.branches.problem import Problem
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.periodic_motions.stops.scenes import Scenes

_KEPT: Final = 4  # structures


class Structures:
    """The structures at values of the parameter, which all curves of a problem share."""

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        self.scenes = lru_cache(1 if problem.frequency else _KEPT)(self._at)
        self._longest = 0.0
        if problem.frequency:
            ends = [problem.at(value).Omega[0] for value in (problem.start, problem.stop)]
            self._longest = 2.0 * math.pi / float(min(ends))

    def at(self, value: float) -> Scenes:
        """Return the structure, which stays the same where the frequency varies."""
        return self.scenes(self._problem.start if self._problem.frequency else value)

    def _at(self, value: float) -> Scenes:
        motions = self._problem.at(value)
        longest = self._longest or 2.0 * math.pi / float(motions.Omega[0])
        method = spectrum.choose(motions.system)
        try:
            return Scenes(motions.system, motions.forces(), longest, method)
        except ModelError as error:
            raise error.under("base") from None
