"""The largest Lyapunov exponent of motions with stops of finite stiffness.

A deviation moves as the structure with the loaded stops does, without load. It goes on unchanged
where a stop switches, but for ``dv -= c (w dx) M^-1 w`` where a dashpot begins to push at its wall
(`periodic_motions.stops.orbit_errors`). Switchings are those of the time history.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.attractors.growth import Exponents, Lengths
from vibroimpact_solvers.attractors.observed import Observed
from vibroimpact_solvers.attractors.problem import Problem
from vibroimpact_solvers.periodic_motions.stops import prescribed
from vibroimpact_solvers.periodic_motions.stops.orbits import Kind, Switching, scenes_of
from vibroimpact_solvers.periodic_motions.stops.scenes import Loaded, Scenes

_LOOK: Final = 64  # events between two reports
_SECTION: Final = -1  # in place of a switching: the end of a period


@dataclass(frozen=True, eq=False, slots=True)
class _Events:
    """Switchings and ends of periods of several motions, filled up after the last one of each."""

    time: Floats  # (motion, event), from the beginning, by the basis' time
    code: Integers  # (motion, event), places in the list of switchings
    count: Integers  # (motion,)
    first: list[Loaded]  # of each motion, what is loaded at its beginning


class OfContacts(Exponents):
    """Computes the largest Lyapunov exponents of motions of one problem.

    Parameters
    ----------
    problem : Problem
    scenes : Scenes
    """

    def __init__(self, problem: Problem, scenes: Scenes) -> None:
        super().__init__(problem, scenes.open.pairs, scenes.scale)
        self._scenes = scenes
        opened = scenes.open
        moving = opened.pairs.moving
        self._live = np.concatenate([moving, moving + opened.size])
        self._switchings: list[Switching] = []
        self._places: dict[Switching, int] = {}
        self._loaded: list[Loaded] = []
        self._jumps: dict[tuple[int, int], tuple[int, Floats]] = {}
        begin = np.zeros(2 * opened.size)
        begin[self._live] = np.random.default_rng(0).standard_normal(self._live.size)
        self._begin = begin

    def lengths(self, motions: Sequence[Observed], report: Callable[[], None]) -> Floats:
        """Return logarithms of the lengths of deviations, shape (motion, section)."""
        events, count = self._events(motions), len(motions)
        scene = np.array([self._scene(loaded) for loaded in events.first])
        w = np.stack([
            self._scenes.passage((), loaded)[0] @ self._begin for loaded in events.first
        ])  # fmt: skip
        lengths = Lengths(count, self._problem.observe + 1)
        before = np.zeros(count)
        for event in range(events.time.shape[1]):
            if event % _LOOK == 0:
                report()
            at = np.flatnonzero(event < events.count)
            span, code = events.time[at, event] - before[at], events.code[at, event]
            before[at] = events.time[at, event]
            now = scene[at]
            for here in np.unique(now).tolist():
                mine = now == here
                rows, side = at[mine], self._scenes.side(self._loaded[here])
                w[rows] = prescribed.apply(side.propagators(span[mine]), w[rows])
                done = rows[code[mine] == _SECTION]
                lengths.shorten(done, w, self._sizes(here, w[done]))
                for switching in np.unique(code[mine][code[mine] != _SECTION]).tolist():
                    some = rows[code[mine] == switching]
                    after, jump = self._jump(here, switching)
                    w[some], scene[some] = w[some] @ jump.T, after
        return lengths.logs

    def _sizes(self, scene: int, w: Floats) -> Floats:
        """Return the lengths of deviations, as of the structure without contacts."""
        matrix, _ = self._scenes.passage(self._loaded[scene], ())
        return np.asarray(np.linalg.norm(w @ matrix[self._live].T, axis=1))

    def _scene(self, loaded: Loaded) -> int:
        if loaded not in self._loaded:
            self._loaded.append(loaded)
        return self._loaded.index(loaded)

    def _jump(self, scene: int, code: int) -> tuple[int, Floats]:
        """Return where a switching leads to, and what it makes of deviations."""
        known = self._jumps.get((scene, code))
        if known is None:
            before, switching = self._loaded[scene], self._switchings[code]
            (after,) = scenes_of(before, [switching])
            at_wall = switching.kind is Kind.WALL
            jump = self._scenes.jump(before, after, switching.stop, at_wall=at_wall)
            known = self._jumps[scene, code] = self._scene(after), jump
        return known

    def _events(self, motions: Sequence[Observed]) -> _Events:
        """Return what happens to motions in order of time, a switching before an end at once."""
        problem, scale = self._problem, self._scenes.scale
        begin, end = float(problem.sections[0]), float(problem.sections[-1])
        ends = (problem.sections[1:] - begin) * scale
        times, codes, firsts = list[Floats](), list[Integers](), list[Loaded]()
        for motion in motions:
            time, code = list[float](), list[int]()
            loaded = list[tuple[int, int]]()
            table = motion.contacts
            names = "constraint", "side", "start", "stop", "velocity"
            for a, side, start, stop, velocity in zip(
                *(table[name].tolist() for name in names), strict=True
            ):
                if start > begin:
                    kind = Kind.WALL if velocity * side > 0.0 else Kind.REGAINED
                    time.append(start)
                    code.append(self._code(Switching(kind, a, side)))
                else:
                    loaded.append((a, side))
                if stop < end:
                    time.append(stop)
                    code.append(self._code(Switching(Kind.LOST, a, side)))
            whole = np.concatenate([(np.array(time) - begin) * scale, ends])
            order = np.argsort(whole, kind="stable")
            times.append(whole[order])
            codes.append(np.array([*code, *[_SECTION] * ends.size])[order])
            firsts.append(tuple(sorted(loaded)))
        most = max(each.size for each in times)
        count = np.array([each.size for each in times])
        filled = [np.pad(each, (0, most - each.size)) for each in times]
        marked = [np.pad(each, (0, most - each.size), constant_values=_SECTION) for each in codes]
        return _Events(np.array(filled), np.array(marked), count, firsts)

    def _code(self, switching: Switching) -> int:
        known = self._places.get(switching)
        if known is None:
            known = self._places[switching] = len(self._switchings)
            self._switchings.append(switching)
        return known
