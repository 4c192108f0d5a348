"""How natural frequencies are computed: all modes at once, or the lowest ones alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

from vibroimpact_solvers import condensation, spectrum
from vibroimpact_solvers.errors import ConvergenceError, PlanError
from vibroimpact_solvers.matrices import Form
from vibroimpact_solvers.model import System
from vibroimpact_solvers.natural_frequencies.problem import COUNT, OUTPUTS, Problem
from vibroimpact_solvers.plan import Plan, Skip, Stage, Step

KIND: Final = "natural-frequencies"
LOWEST: Final = "lowest modes"
"""Name of the method that computes the lowest modes alone."""

_ALL_UP_TO: Final = 256  # degrees of freedom up to which all modes cost little
_FEW: Final = 3  # all modes cost less where more than 1/3 of them are asked for
_FACTORS: Final = 15  # factorizations of counts and of the search
_SOLVES: Final = 4.0  # solves of the search for each mode

_DIRECT: Final = {spectrum.Method.CLOSED_FORM, spectrum.Method.DIAGONAL}


@dataclass(frozen=True, slots=True)
class Decision:
    """How modes are computed."""

    method: spectrum.Method | None  # of all modes; None: the lowest alone
    expected: int  # modes in the result, as far as is known


def plan(problem: Problem) -> Plan:
    """Choose how natural frequencies are computed."""
    system = problem.moving
    decision = _decision(problem)
    if decision.method is None:
        modes = _lowest_step(system, decision)
    else:
        modes = spectrum.step(system, decision.method)
        if modes.bytes > spectrum.MEMORY:
            message = f"the natural modes take more than {modes.bytes / 1e9:.0f} GB"
            raise PlanError(message, ("system",))
        modes = replace(modes, settings=decision)
    wanted = COUNT if problem.count is None else problem.count
    if problem.stop is None and problem.modes < wanted:
        reason = f"{modes.reason}; the structure has {problem.modes} modes and no more"
        modes = replace(modes, reason=reason)
    if problem.fixed:
        listed = ", ".join(map(str, sorted(problem.fixed)))
        plural = "s" if len(problem.fixed) > 1 else ""
        reason = f"constraint{plural} {listed} held: {system.n} coordinates remain; {modes.reason}"
        modes = replace(modes, reason=reason)
    return Plan(KIND, (modes, *_outputs(problem, decision)), tuple(_skips(problem, decision)))


def _decision(problem: Problem) -> Decision:
    system, most = problem.moving, problem.most
    method = spectrum.choose(system)
    full = Form.DENSE in {system.M.form, system.K.form}
    # Rates of shapes are sums over all modes.
    turned = bool(problem.parameters) and problem.outputs != {"Omega"}
    if turned or method in _DIRECT or full or problem.modes <= _ALL_UP_TO:
        return Decision(method, most)
    if problem.stop is not None:
        try:
            most = spectrum.count_below(system, problem.stop**2)
        except ConvergenceError:
            return Decision(method, most)
    return Decision(method if most * _FEW > problem.modes else None, most)


def _lowest_step(system: System, decision: Decision) -> Step:
    n, count = float(system.n), float(decision.expected + 8)
    reason = (
        f"about {decision.expected} of {system.n} modes are asked for: shift-invert Lanczos finds "
        "them, counts by Sylvester's law of inertia prove that none is missing"
    )
    if system.massless.size:
        reason = f"{condensation.sentence(system)}; {reason}"
    flops = _FACTORS * spectrum.factor_flops(system)
    flops += _SOLVES * count * spectrum.solve_flops(system) + 40.0 * n * count**2
    flops += 40.0 * count * (system.K.entries + system.M.entries)
    return Step(Stage.SPECTRUM, LOWEST, reason, flops, 32.0 * n * count, settings=decision)


def _outputs(problem: Problem, decision: Decision) -> Iterator[Step]:
    n, count = float(problem.system.n), float(decision.expected)
    limiters, outputs = len(problem.system.constraints), problem.outputs
    bases = 0 if problem.directions is None else len(problem.directions)
    sizes = {"Omega": 3.0, "shape": 2.0 * n, "participation": 2.0 * limiters}
    sizes["effective_mass"] = 2.0 * bases
    columns = sum(size for name, size in sizes.items() if name == "Omega" or name in outputs)
    flops = 10.0 * count * columns
    if outputs & {"participation", "effective_mass"}:
        flops += 10.0 * count * n * (1.0 + bases)
    reason = "ascending, of unit modal mass, the largest entry of each mode positive"
    yield Step(Stage.SHAPE, "rows of the modes", reason, flops, 8.0 * count * columns)
    if problem.parameters:
        yield _derivatives_step(problem, columns)
    if "residual_flexibility" not in outputs:
        return
    if decision.method is None:
        reason = "static solves with the modes that are known taken out"
        moving = problem.moving
        flops = spectrum.factor_flops(moving) + 20.0 * limiters * spectrum.solve_flops(moving)
    else:
        reason = "the sum over all modes that are left out"
        flops = 10.0 * n * limiters**2
    yield Step(Stage.RESPONSE, "residual flexibility", reason, flops + 1.0, 16.0 * limiters**2)


def _derivatives_step(problem: Problem, columns: float) -> Step:
    count, n = float(len(problem.parameters)), float(problem.moving.n)
    plural = "s" if count > 1 else ""
    reason = (
        f"by {len(problem.parameters)} parameter{plural}: rates of the eigenvalues and of the "
        "modes, by products with the modes that are known"
    )
    flops = count * (20.0 * n**2 + 2.0 * n * problem.most * columns)
    flops += sum(each.structural for each in problem.parameters) * 4.0 * n**3
    size = 16.0 * count * problem.most * columns
    return Step(Stage.DERIVATIVES, "rates of the modes", reason, flops, size)


def _skips(problem: Problem, decision: Decision) -> Iterator[Skip]:
    system = problem.system
    if decision.method is None:
        yield Skip(f"about {problem.modes - decision.expected} higher modes", "not requested")
    if system.C is not None and system.C.data.any():
        yield Skip("damping", "natural frequencies are those of the undamped structure")
    if system.constraints:
        yield Skip("walls", "natural frequencies are those of the structure between its stops")
    for name in OUTPUTS:
        if name not in problem.outputs and name != "Omega":
            yield Skip(name, "not requested")
    if not problem.parameters:
        yield Skip("derivatives", "not requested")
