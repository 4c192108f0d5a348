"""Which stage of a computation each field of its request spoils: the one table of sweeps.

To let a kind be swept:

1. Add a row to `KINDS`: its solver module and rules for the fields of its request. The first
   rule whose pattern fits a path counts. A field without a rule spoils everything, which is
   always right and never fast.
2. Name in the row the dimensions whose length differs from result to result (``ragged``), and
   outputs that are absent where they equal another one (``absent``).
3. Add its document to `vibroimpact_schema.sweeps` and an example.
4. Where work can be shared between problems with the same natural modes, offer ``together``
   (see `vibroimpact_solvers.impact_modes.together`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any, Final

from vibroimpact_solvers import existence_bands, impact_modes, resonances, slow_flow, time_history
from vibroimpact_solvers.errors import SolverError
from vibroimpact_solvers.impact_modes.together import members, together
from vibroimpact_solvers.plan import Stage

Path = Sequence[str | int]
Outcome = Any | SolverError
"""A result, or why there is none."""


@dataclass(frozen=True, slots=True)
class Rule:
    """What the fields of a pattern spoil.

    Parameters
    ----------
    pattern : str
        Path with dots; ``*`` stands for any one part and a last ``**`` for any rest.
    stage : Stage or None
        The first stage that must be done again; None: none, the results do not depend on it.
    why : str
        The sentence for a plan, where it is None.
    moves : tuple of str
        Coordinates of the results that change with it.
    unless : mapping
        Outputs with which it spoils another stage.
    """

    pattern: str
    stage: Stage | None
    why: str = ""
    moves: tuple[str, ...] = ()
    unless: Mapping[str, Stage] = field(default_factory=dict)

    def fits(self, path: Path) -> bool:
        """Whether the pattern fits a path."""
        return _fits(self.pattern, path)


@dataclass(frozen=True, slots=True)
class Swept:
    """One kind that can be swept.

    Parameters
    ----------
    solver : module
        Offers ``plan``, ``solve`` and ``Result``.
    rules : tuple of Rule
        What fields spoil; the first that fits counts.
    ragged : frozenset of str
        Dimensions whose length differs from point to point.
    absent : mapping
        Output -> the output that it equals where it is absent.
    members : callable, optional
        Returns how many responses a problem asks for; absent: one.
    together : callable, optional
        Solves problems with the same natural modes and gives an outcome for each in order, equal
        to the last bit to what ``solve`` returns for it alone; calls its second argument now and
        then, which may raise to stop it. Absent: one after the other.
    """

    solver: ModuleType
    rules: tuple[Rule, ...]
    ragged: frozenset[str] = frozenset()
    absent: Mapping[str, str] = field(default_factory=dict)
    members: Callable[[Any], int] | None = None
    together: Callable[[Sequence[Any], Callable[[], None]], Iterable[Outcome]] | None = None


_LOSSLESS: Final = "impact modes are motions without loss"
_HELD: Final = "the coordinate is held, wherever its walls are"
_STABILITY: Final = {"stability": Stage.STABILITY}
_EVERYTHING: Final = Rule("**", Stage.SPECTRUM)

KINDS: Final[Mapping[str, Swept]] = {
    "impact-modes": Swept(
        impact_modes,
        (
            Rule("frequency.**", Stage.RESPONSE, moves=("Omega", "omega")),
            Rule("system.constraints.*.gap.**", Stage.IMPULSE),
            Rule("system.constraints.*.restitution", None, _LOSSLESS, unless=_STABILITY),
            Rule("system.constraints.**", Stage.RESPONSE),
            Rule("system.force.*", Stage.RESPONSE),
            Rule("system.g", Stage.RESPONSE),
            Rule("system.C.**", None, _LOSSLESS, unless=_STABILITY),
            Rule("system.zeta", None, _LOSSLESS, unless=_STABILITY),
            Rule("active.*", Stage.RESPONSE, moves=("constraint",)),
            Rule("tau.*", Stage.WAVEFORM, moves=("tau",)),
            Rule("dofs.*", Stage.SHAPE, moves=("dof",)),
            Rule("tolerance", Stage.IMPULSE),
        ),
        absent={"impulse_lower": "impulse"},
        members=members,
        together=together,
    ),
    "existence-bands": Swept(
        existence_bands,
        (
            Rule("frequency.**", Stage.EXISTENCE),
            Rule("system.constraints.*.restitution", None, _LOSSLESS, unless=_STABILITY),
            Rule("system.constraints.**", Stage.RESPONSE),
            Rule("system.force.*", Stage.RESPONSE),
            Rule("system.g", Stage.RESPONSE),
            Rule("system.C.**", None, _LOSSLESS, unless=_STABILITY),
            Rule("system.zeta", None, _LOSSLESS, unless=_STABILITY),
            Rule("active.*", Stage.RESPONSE),
            Rule("tolerance", Stage.EXISTENCE),
        ),
        ragged=frozenset({"bands", "rejected", "stability", "unresolved"}),
    ),
    "resonances": Swept(
        resonances,
        (
            Rule("system.constraints.*.restitution", None, _HELD),
            Rule("system.constraints.*.gap.**", None, _HELD),
        ),
        ragged=frozenset({"resonance"}),
    ),
    "time-history": Swept(
        time_history,
        (
            Rule("system.constraints.**", Stage.FLIGHT),
            Rule("initial.**", Stage.FLIGHT),
            Rule("load.**", Stage.FLIGHT),
            Rule("t_end", Stage.FLIGHT, moves=("t",)),
            Rule("t.*", Stage.FLIGHT, moves=("t",)),
            Rule("dofs.*", Stage.FLIGHT, moves=("dof",)),
            Rule("tolerance", Stage.FLIGHT),
        ),
        ragged=frozenset({"impact", "contact"}),
        together=time_history.together,
    ),
    "slow-flow": Swept(
        slow_flow,
        (
            Rule("t.**", Stage.SLOW_FLOW, moves=("t",)),
            Rule("**", Stage.SLOW_FLOW),
        ),
        ragged=frozenset({"impact"}),
    ),
}


def rule(kind: str, path: Path) -> Rule:
    """Return the rule for a field of a kind's request."""
    return next((r for r in KINDS[kind].rules if r.fits(path)), _EVERYTHING)


_LENGTH, _MASS, _STIFFNESS = "length", "mass", "mass time-2"
_FORCE, _FREQUENCY = "mass length time-2", "time-1"

_FIELDS: Final = (
    ("system.constraints.*.gap", _LENGTH, "gap"),
    ("system.constraints.*.gap.lower", _LENGTH, "distance to the lower wall"),
    ("system.constraints.*.gap.upper", _LENGTH, "distance to the upper wall"),
    ("system.constraints.*.restitution", "1", "coefficient of restitution"),
    ("system.constraints.*.dof", "1", "constrained degree of freedom"),
    ("system.constraints.*.direction.weights.*", "1", "weight in the constrained coordinate"),
    ("system.M.**", _MASS, "mass"),
    ("system.K.**", _STIFFNESS, "stiffness"),
    ("system.C.**", "mass time-1", "damping"),
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
    """Return the dimension and the name of the quantity that a field holds.

    A field that the table does not list is called by its path and is a pure number.
    """
    for pattern, unit, name in _FIELDS:
        if _fits(pattern, path):
            return unit, name
    return "1", ".".join(str(part) for part in path)


def _fits(pattern: str, path: Path) -> bool:
    parts = pattern.split(".")
    if parts[-1] == "**":
        parts = parts[:-1]
        if len(path) < len(parts):
            return False
    elif len(parts) != len(path):
        return False
    return all(p in ("*", str(q)) for p, q in zip(parts, path, strict=False))
