"""The kinds of computation that can be swept, and the stage that each field invalidates.

To let a kind be swept:

1. Add a row to `KINDS`: its solver module and rules for the fields of its request. The first
   rule whose pattern matches a path applies. A field without a rule invalidates all stages,
   which is always correct and never fast.
2. Name in the row the dimensions whose length differs from point to point (``ragged``), and
   outputs that are absent where they equal another one (``absent``).
3. Add its document to `vibroimpact_schema.sweeps` and an example.
4. If points can start where others ended, give ``continued``, a module as `Continued` says.
5. If problems with the same natural modes can share work, give ``solve_many``
   (see `vibroimpact_solvers.impact_modes.shared_responses`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any, Final, Protocol

from vibroimpact_solvers import (
    attractors,
    existence_bands,
    impact_modes,
    natural_frequencies,
    periodic_motions,
    resonances,
    slow_flow,
    time_history,
)
from vibroimpact_solvers.errors import SolverError
from vibroimpact_solvers.impact_modes.shared_responses import response_count, solve_many
from vibroimpact_solvers.model import System
from vibroimpact_solvers.plan import Stage

Path = Sequence[str | int]
Outcome = Any | SolverError
"""A result, or the error instead of it."""


@dataclass(frozen=True, slots=True)
class Rule:
    """The stage that the fields of a pattern invalidate.

    Parameters
    ----------
    pattern : str
        Path with dots; ``*`` stands for any one part and a last ``**`` for any rest.
    stage : Stage or None
        The first stage that must be computed again; None: the results do not depend on the field.
    why : str
        The reason in a plan, where it is None.
    changes : tuple of str
        Coordinates of the results that change with it.
    unless : mapping
        Outputs with which the field invalidates another stage.
    """

    pattern: str
    stage: Stage | None
    why: str = ""
    changes: tuple[str, ...] = ()
    unless: Mapping[str, Stage] = field(default_factory=dict)


class Continued(Protocol):
    """What a kind offers whose points may start where others ended: a module of functions."""

    def start(self, system: System, end: Any) -> Any:
        """Return the initial state, as the kind's problem takes it, from the end of a point."""

    def going_on(self, problem: Any, end: Any) -> Any:
        """Return the problem with what else goes on from the end of a point."""

    def motions(self, problem: Any) -> int:
        """Return how many motions a point takes, that to its end included."""

    def solve_each(
        self, problems: Sequence[Any], before: Sequence[Any], report: Callable[[], None]
    ) -> Iterator[tuple[Outcome, Any]]:
        """Yield the outcome of each problem and its end, None where there is none.

        before are the ends from which they go on, None of those with their own initial states.
        """


@dataclass(frozen=True, slots=True)
class SweptKind:
    """A kind of computation that can be swept.

    Parameters
    ----------
    solver : module
        Has ``plan``, ``solve`` and ``Result``.
    rules : tuple of Rule
        Stages that fields invalidate; the first match applies.
    ragged : frozenset of str
        Dimensions whose length differs from point to point.
    absent : mapping
        Output -> the output that it equals where it is absent.
    response_count : callable, optional
        Returns the number of responses of a problem; absent: one.
    solve_many : callable, optional
        Solves problems with the same natural modes and returns an outcome for each in order,
        equal to the last bit to that of ``solve``; calls its second argument while it runs, which
        may raise to stop it. Absent: one after the other.
    continued : Continued, optional
        Lets points start where others ended.
    """

    solver: ModuleType
    rules: tuple[Rule, ...]
    ragged: frozenset[str] = frozenset()
    absent: Mapping[str, str] = field(default_factory=dict)
    response_count: Callable[[Any], int] | None = None
    solve_many: Callable[[Sequence[Any], Callable[[], None]], Iterable[Outcome]] | None = None
    continued: Continued | None = None


_LOSSLESS: Final = "impact modes are motions without energy loss"
_FIXED: Final = "the coordinate is fixed, wherever its walls are"
_UNDAMPED: Final = "natural frequencies are those of the undamped structure between its stops"
_STABILITY: Final = {"stability": Stage.STABILITY}
_STRUCTURE: Final = (
    Rule("system.constraints.*.restitution", None, _LOSSLESS, unless=_STABILITY),
    Rule("system.constraints.**", Stage.RESPONSE),
    Rule("system.force.*", Stage.RESPONSE),
    Rule("system.g", Stage.RESPONSE),
    Rule("system.C.**", None, _LOSSLESS, unless=_STABILITY),
    Rule("system.zeta", None, _LOSSLESS, unless=_STABILITY),
    Rule("system.damping.**", None, _LOSSLESS, unless=_STABILITY),
    Rule("system.dashpots.**", None, _LOSSLESS, unless=_STABILITY),
    Rule("system.influence.*", None, "impact modes have no drive"),
)
"""Rules that impact modes and existence bands share."""
_EVERYTHING: Final = Rule("**", Stage.SPECTRUM)

KINDS: Final[Mapping[str, SweptKind]] = {
    "natural-frequencies": SweptKind(
        natural_frequencies,
        (
            Rule("system.constraints.*.restitution", None, _UNDAMPED),
            Rule("system.constraints.*.gap.**", None, _UNDAMPED),
            Rule("system.force.*", None, _UNDAMPED),
            Rule("system.g", None, _UNDAMPED),
            Rule("system.C.**", None, _UNDAMPED),
            Rule("system.zeta", None, _UNDAMPED),
            Rule("system.damping.**", None, _UNDAMPED),
            Rule("system.dashpots.**", None, _UNDAMPED),
        ),
        response_count=natural_frequencies.mode_count,
    ),
    "impact-modes": SweptKind(
        impact_modes,
        (
            Rule("frequency.**", Stage.RESPONSE, changes=("Omega", "omega")),
            Rule("system.constraints.*.gap.**", Stage.IMPULSE),
            *_STRUCTURE,
            Rule("active.*", Stage.RESPONSE, changes=("constraint",)),
            Rule("tau.*", Stage.WAVEFORM, changes=("tau",)),
            Rule("dofs.*", Stage.SHAPE, changes=("dof",)),
            Rule("tolerance", Stage.IMPULSE),
        ),
        absent={
            "impulse_lower": "impulse",
            "momentum_lower": "momentum",
            "impulse_lower_error": "impulse_error",
            "momentum_lower_error": "momentum_error",
        },
        response_count=response_count,
        solve_many=solve_many,
    ),
    "existence-bands": SweptKind(
        existence_bands,
        (
            Rule("frequency.**", Stage.EXISTENCE),
            *_STRUCTURE,
            Rule("active.*", Stage.RESPONSE),
            Rule("tolerance", Stage.EXISTENCE),
        ),
        ragged=frozenset({"bands", "rejected", "stability", "unresolved"}),
    ),
    "resonances": SweptKind(
        resonances,
        (
            Rule("system.constraints.*.restitution", None, _FIXED),
            Rule("system.constraints.*.gap.**", None, _FIXED),
        ),
        ragged=frozenset({"resonance"}),
    ),
    "periodic-motions": SweptKind(
        periodic_motions,
        (
            Rule("frequency.**", Stage.IMPULSE, changes=("Omega",)),
            Rule("system.constraints.**", Stage.IMPULSE),
            Rule("load.**", Stage.IMPULSE),
            Rule("tau.*", Stage.WAVEFORM, changes=("tau",)),
            Rule("dofs.*", Stage.ENERGY, changes=("dof",)),
            Rule("tolerance", Stage.IMPULSE),
        ),
        ragged=frozenset({"solution", "impact", "contact"}),
    ),
    "attractors": SweptKind(
        attractors,
        (
            Rule("frequency.**", Stage.FREE_MOTION),
            Rule("system.constraints.**", Stage.FREE_MOTION),
            Rule("load.**", Stage.FREE_MOTION),
            Rule("initial.**", Stage.FREE_MOTION),
            Rule("settle", Stage.FREE_MOTION),
            Rule("observe", Stage.FREE_MOTION),
            Rule("dofs.*", Stage.FREE_MOTION, changes=("dof",)),
            Rule("tolerance", Stage.FREE_MOTION),
        ),
        ragged=frozenset({"attractor", "impact", "contact", "section"}),
        continued=attractors.continued,
    ),
    "time-history": SweptKind(
        time_history,
        (
            Rule("system.constraints.**", Stage.FREE_MOTION),
            Rule("initial.**", Stage.FREE_MOTION),
            Rule("load.**", Stage.FREE_MOTION),
            Rule("t_end", Stage.FREE_MOTION, changes=("t",)),
            Rule("t.*", Stage.FREE_MOTION, changes=("t",)),
            Rule("dofs.*", Stage.FREE_MOTION, changes=("dof",)),
            Rule("tolerance", Stage.FREE_MOTION),
        ),
        ragged=frozenset({"impact", "contact"}),
        solve_many=time_history.solve_many,
        continued=time_history.continued,
    ),
    "slow-flow": SweptKind(
        slow_flow,
        (
            Rule("t.**", Stage.SLOW_FLOW, changes=("t",)),
            Rule("**", Stage.SLOW_FLOW),
        ),
        ragged=frozenset({"impact"}),
    ),
}


def rule(kind: str, path: Path) -> Rule:
    """Return the rule for a field of a kind's request."""
    return next((r for r in KINDS[kind].rules if _matches(r.pattern, path)), _EVERYTHING)


_LENGTH, _MASS, _STIFFNESS = "length", "mass", "mass time-2"
_FORCE, _FREQUENCY = "mass length time-2", "time-1"

_FIELDS: Final = (
    ("system.constraints.*.gap", _LENGTH, "gap"),
    ("system.constraints.*.gap.lower", _LENGTH, "distance to the lower wall"),
    ("system.constraints.*.gap.upper", _LENGTH, "distance to the upper wall"),
    ("system.constraints.*.restitution", "1", "coefficient of restitution"),
    ("system.constraints.*.wall.*.amplitude", _LENGTH, "amplitude of the wall"),
    ("system.constraints.*.wall.*.frequency", _FREQUENCY, "frequency of the wall"),
    ("system.constraints.*.wall.*.phase", "1", "phase of the wall"),
    ("system.constraints.*.dof", "1", "constrained degree of freedom"),
    ("system.constraints.*.direction.weights.*", "1", "weight in the constrained coordinate"),
    ("system.M.**", _MASS, "mass"),
    ("system.K.**", _STIFFNESS, "stiffness"),
    ("system.C.**", "mass time-1", "damping"),
    ("system.damping.ratio", "1", "damping ratio"),
    ("system.damping.ratio.*", "1", "damping ratio of a mode"),
    ("system.damping.rayleigh.0", _FREQUENCY, "damping by the masses, alpha"),
    ("system.damping.rayleigh.1", "time", "damping by the springs, beta"),
    ("system.damping.rayleigh.ratios.*", "1", "damping ratio"),
    ("system.damping.rayleigh.at.*", "1", "frequency of the damping ratio"),
    ("system.damping.structural", "1", "loss factor"),
    ("system.damping.at", "1", "frequency of the loss factor"),
    ("system.dashpots.*.c", "mass time-1", "coefficient of the dashpot"),
    ("system.dashpots.*.weights.*", "1", "weight in the coordinate of the dashpot"),
    ("system.influence.*", "1", "displacement by a unit displacement of the base"),
    ("system.residual_flexibility.*.*", "time2 mass-1", "residual flexibility"),
    ("system.force.*", _FORCE, "static load"),
    ("system.mass", _MASS, "mass"),
    ("system.stiffness", _STIFFNESS, "stiffness"),
    ("system.Omega0", _FREQUENCY, "natural angular frequency"),
    ("system.zeta", "1", "damping ratio"),
    ("system.coupling", "1", "coupling"),
    ("system.mu", "1", "square root of the mass ratio"),
    ("system.g", "length time-2", "acceleration of gravity"),
    ("frequency.num", "1", "number of frequencies"),
    ("frequency.**", _FREQUENCY, "frequency"),
    ("initial.x.*.*", _LENGTH, "initial displacement"),
    ("initial.v.*.*", "length time-1", "initial velocity"),
    ("initial.x.*", _LENGTH, "initial displacement"),
    ("initial.v.*", "length time-1", "initial velocity"),
    ("initial.impact_mode.Omega", _FREQUENCY, "frequency of the impact mode"),
    ("load.*.amplitude", _FORCE, "amplitude of the load"),
    ("load.*.frequency", _FREQUENCY, "frequency of the load"),
    ("load.*.phase", "1", "phase of the load"),
    ("initial.omega", _FREQUENCY, "initial triangle-wave frequency"),
    ("initial.gamma", "1", "initial frequency ratio"),
    ("initial.phi", "1", "initial phase"),
    ("initial.A", _LENGTH, "initial sine amplitude"),
    ("initial.B", _LENGTH, "initial cosine amplitude"),
    ("initial.energy", "mass length2 time-2", "initial energy"),
    ("initial.x", _LENGTH, "initial displacement"),
    ("initial.v", "length time-1", "initial velocity"),
    ("t_end", "time", "length of the motion"),
    ("t.**", "time", "time"),
    ("tau.*", "1", "triangle-wave time"),
)


def meaning(path: Path) -> tuple[str, str]:
    """Return the unit and the name of the quantity in a field.

    A field that is not in the table is a pure number named by its path.
    """
    for pattern, unit, name in _FIELDS:
        if _matches(pattern, path):
            return unit, name
    return "1", ".".join(str(part) for part in path)


def _matches(pattern: str, path: Path) -> bool:
    parts = pattern.split(".")
    if parts[-1] == "**":
        parts = parts[:-1]
        if len(path) < len(parts):
            return False
    elif len(parts) != len(path):
        return False
    return all(p in ("*", str(q)) for p, q in zip(parts, path, strict=False))
