"""What a parameter does not touch is computed once: modes are factorized once in a sweep."""

from __future__ import annotations

from itertools import count
from typing import Any

import numpy as np
import pytest
import scipy.linalg

from vibroimpact_service import local_process
from vibroimpact_service.documents import planning, requests
from vibroimpact_service.kinds import KINDS

pytestmark = pytest.mark.needs("compiled kernels")

N = 6
K = 2.0 * np.eye(N) - np.eye(N, k=1) - np.eye(N, k=-1)
K += 0.05 * (np.eye(N, k=2) + np.eye(N, k=-2))
LOAD = [{"dof": 2, "amplitude": 1.0}]
GAP, RESTITUTION = "system.constraints.0.gap", "system.constraints.0.restitution"
DRIVE, FREQUENCY, ALPHA = "load.0.amplitude", "frequency.values.0", "system.damping.rayleigh.0"
BASES: dict[str, dict[str, Any]] = {
    "natural-frequencies": {},
    "impact-modes": {"frequency": {"values": [2.1, 2.3]}},
    "existence-bands": {"frequency": {"start": 2.0, "stop": 2.4}},
    "resonances": {},
    "time-history": {
        "initial": {"x": [0.0] * N, "v": [1.0, *[0.0] * (N - 1)]},
        "t_end": 20.0,
        "load": [{**LOAD[0], "frequency": 0.7}],
    },
    "periodic-motions": {"frequency": {"values": [0.7]}, "load": LOAD},
    "attractors": {
        "frequency": {"values": [0.7]},
        "load": LOAD,
        "initial": {"x": [[0.0] * N], "v": [[1.0, *[0.0] * (N - 1)]]},
        "settle": 5,
        "observe": 40,
    },
}
AXES = {
    "natural-frequencies": (GAP,),
    "impact-modes": (GAP, FREQUENCY),
    "existence-bands": (GAP, "frequency.start"),
    "resonances": (GAP,),
    "time-history": (GAP, RESTITUTION, DRIVE, "load.0.frequency", "initial.v.0", ALPHA),
    "periodic-motions": (GAP, RESTITUTION, DRIVE, FREQUENCY, ALPHA),
    "attractors": (GAP, RESTITUTION, DRIVE, FREQUENCY, "initial.v.0.0", ALPHA),
}
DASHPOTS = {"dashpots": [{"dofs": [0, 3], "weights": [1.0, -1.0], "c": 0.05}]}
CASES = [(kind, path, {}) for kind, paths in AXES.items() for path in paths]
CASES += [
    (kind, path, DASHPOTS)
    for kind in ("time-history", "periodic-motions", "attractors")
    for path in AXES[kind]
    if path != ALPHA
]
_other = count(1)


@pytest.fixture
def factors(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Give the names of the eigenvalue problems that are solved."""
    solved_problems = list[str]()

    def counted(function: Any, name: str) -> Any:
        def solved(*args: Any, **options: Any) -> Any:
            solved_problems.append(name)
            return function(*args, **options)

        return solved

    for module in (scipy.linalg, np.linalg):
        for name in ("eig", "eigh", "eigvals", "eigvalsh", "eig_banded", "eigh_tridiagonal"):
            if hasattr(module, name):
                monkeypatch.setattr(module, name, counted(getattr(module, name), name))
    return solved_problems


def swept(kind: str, path: str, damping: dict[str, Any], points: int) -> None:
    """Compute a sweep of a structure unlike all before, of which nothing is known."""
    M = np.eye(N) + np.diag(0.01 * np.arange(N)) * (1.0 + 1e-3 * next(_other))
    driven = "load" in BASES[kind]
    stop = {"dof": 2, "gap": 0.5, "restitution": 0.8 if driven else 1.0}
    system = {"M": M.tolist(), "K": K.tolist(), "constraints": [stop]}
    if driven:
        system |= damping or {"damping": {"rayleigh": [0.01, 0.02]}}
    base: Any = {"system": system, **BASES[kind]}
    value = base
    for part in path.split("."):
        value = value[int(part) if part.isdigit() else part]
    values = [float(value) * (1.0 - 0.001 * k) for k in range(points)]
    content = {"kind": kind, "base": base, "axes": [{"path": path, "values": values}]}
    request = requests.read("somebody", KINDS["sweep"], content)
    planned = planning.plan(local_process.no_systems(), request.kind, request.document)
    result = planned.kind.solver.solve(planned.problem, planned.plan, None)
    assert not result.arrays["status"].any()


@pytest.mark.parametrize(("kind", "path", "damping"), CASES)
def test_modes_are_computed_once(
    kind: str, path: str, damping: dict[str, Any], factors: list[str]
) -> None:
    swept(kind, path, damping, 2)
    of_two = sorted(factors)
    factors.clear()
    swept(kind, path, damping, 5)
    assert of_two
    assert sorted(factors) == of_two


def test_what_a_parameter_touches_is_computed_for_each(factors: list[str]) -> None:
    swept("impact-modes", "system.M.0.0", {}, 2)
    of_two = len(factors)
    factors.clear()
    swept("impact-modes", "system.M.0.0", {}, 5)
    assert len(factors) - of_two == 3
