"""Random derivatives of impact modes, and what their results state against what is true."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tests.reference import differences
from tests.reference.balls import UndecidedError
from tests.truth import impact_modes as families
from tests.truth import structures
from vibroimpact_solvers import impact_modes
from vibroimpact_solvers.derivatives import MatrixRate, Parameter, StopRate
from vibroimpact_solvers.errors import SolverError
from vibroimpact_solvers.model import SymmetricMatrix

OUTPUTS = frozenset({"impulse", "shape", "waveform", "energy"})
TAU = (-0.71875, 0.3125)
_ROUNDED = 2.0**-53
_ZERO = 1e-150  # what a difference may leave of zero


@dataclass(frozen=True)
class Compared:
    """One output of one solution, differentiated by one parameter."""

    seed: int
    name: str
    parameter: str
    output: str
    size: float  # largest true derivative
    wrong: float  # largest difference from it
    stated: float  # largest stated error
    within: bool  # whether all differences are within the stated errors

    @property
    def over(self) -> float:
        """Stated over true error, which is not less than the rounding of the result."""
        return self.stated / max(self.wrong, _ROUNDED * self.size)


def parameters(
    rng: np.random.Generator, document: structures.Document
) -> list[tuple[Parameter, differences.Change]]:
    """Return parameters of all sorts, and the same for the reference."""
    n, limiters, active = len(document["M"]), document["constraints"], document["active"]
    struck = int(rng.choice(active))
    place, limiter = active.index(struck), limiters[struck]
    both = float(limiter["lower"] is not None), float(limiter["upper"] is not None)
    i, j = (int(k) for k in rng.integers(n, size=2))
    entry = np.zeros((n, n))
    entry[i, j] = entry[j, i] = 1.0
    force, turned = np.zeros(n), np.zeros((len(active), n))
    force[rng.integers(n)] = 1.0
    dof = int(rng.integers(n))
    turned[place, dof] = 1.0
    one = MatrixRate(entries=SymmetricMatrix.dense(entry))
    change = differences.Change
    found = [
        (Parameter("gap", stops=(StopRate(struck, *both),)), change(walls={place: both})),
        (Parameter("K.scale", K=MatrixRate(1.0)), change(K=np.array(document["K"]))),
        (Parameter("M.scale", M=MatrixRate(1.0)), change(M=np.array(document["M"]))),
        (Parameter("K.entry", K=one), change(K=entry)),
        (Parameter("M.entry", M=one), change(M=entry)),
        (Parameter("frequency", frequency=1.0), change(Omega=1.0)),
        (Parameter("force", force=force), change(force=force)),
        (
            Parameter("weight", stops=(StopRate(struck, weights=((dof, 1.0),)),)),
            change(rows=turned),
        ),
    ]
    if all(both):
        upper = Parameter("gap.upper", stops=(StopRate(struck, upper=1.0),))
        found.append((upper, change(walls={place: (0.0, 1.0)})))
    return found


def compared(seed: int) -> tuple[list[Compared], int]:
    """Return a random solution's derivatives beside the truth, and how many there are none of."""
    rng = np.random.default_rng(seed)
    case = families.case(rng)
    document = case.document
    given = parameters(rng, document)
    try:
        problem = replace(
            families.problem_of(document, OUTPUTS, TAU), parameters=tuple(p for p, _ in given)
        )
        result = impact_modes.solve(problem, impact_modes.plan(problem))
    except SolverError:  # a load that nothing balances
        return [], 0
    limiters = [document["constraints"][a] for a in document["active"]]
    data = differences.Data.of(
        document["M"],
        document["K"],
        document.get("force"),
        np.array([structures.row(document, each) for each in limiters]),
        [(each["lower"], each["upper"]) for each in limiters],
        document["Omega"],
    )
    found, none = [], 0
    for place, (parameter, change) in enumerate(given):
        try:
            true = differences.derivative(data, change, TAU)
        except UndecidedError:
            continue
        assert result.derivative_reason is not None
        if result.derivative_reason[0, place]:
            none += 1
            continue
        for output, values in true.items():
            one = _compared(result, place, output, values)
            if one is not None:
                found.append(Compared(seed, case.name, parameter.path, output, *one))
    return found, none


def _compared(
    result: Any, place: int, output: str, true: Any
) -> tuple[float, float, float, bool] | None:
    values = getattr(result, f"derivative_{output}")
    if values is None:  # alike at both walls
        return None
    stated = getattr(result, f"derivative_{output}_error")[..., place].ravel()
    true = np.where(np.abs(true) < _ZERO, 0.0, true)
    wrong = np.abs(values[..., place].ravel() - true)
    sizes = float(np.abs(true).max()), float(wrong.max()), float(stated.max())
    return *sizes, bool((wrong <= stated).all())


def main(first: int, last: int) -> None:
    """Print what the derivatives of some seeds state against what is true."""
    pairs = [compared(seed) for seed in range(first, last)]
    found = [one for each, _ in pairs for one in each if one.size]
    relative = np.array([one.wrong / one.size for one in found])
    over = [one.over for one in found]
    outside = [one for one in found if not one.within]
    print(f"{len(found)} outputs, {sum(none for _, none in pairs)} parameters without derivatives")
    print(
        "relative errors",
        np.quantile(relative, [0.5, 0.9, 0.99, 1.0]),
        "stated/true",
        np.median(over),
    )
    print(f"{(relative > 1e-10).mean():.2%} above 1e-10, {len(outside)} outside")
    for one in outside:
        print(one)


if __name__ == "__main__":
    import sys

    main(int(sys.argv[1]), int(sys.argv[2]))
