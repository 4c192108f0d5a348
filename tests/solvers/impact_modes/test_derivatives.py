"""Derivatives of impact modes against differences of an independent solver in ball arithmetic."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.reference import differences
from tests.solvers import beams
from tests.solvers.structures import chain
from tests.truth import derivatives as truth
from vibroimpact_solvers import impact_modes
from vibroimpact_solvers.derivatives import MatrixRate, Parameter, StopRate
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.plan import Stage

GAP = Parameter("gap", "length", stops=(StopRate(0, 1.0, 1.0),))
STIFFNESS = Parameter("K.scale", K=MatrixRate(1.0))
FREQUENCY = Parameter("frequency", "time-1", frequency=1.0)
ALL = frozenset({"impulse", "shape", "waveform", "energy", "harmonics"})


def solved(problem: impact_modes.Problem) -> impact_modes.Result:
    return impact_modes.solve(problem, impact_modes.plan(problem))


def problem(system: System, Omega: np.ndarray, *parameters: Parameter) -> impact_modes.Problem:
    return impact_modes.Problem(
        system,
        Omega * (2.0 / np.pi),
        outputs=ALL,
        tau=np.array([-0.7, 0.3]),
        Omega=Omega,
        parameters=parameters,
    )


@pytest.mark.parametrize("seeds", [range(10 * k, 10 * k + 10) for k in range(4)], ids=str)
def test_random_structures(seeds: range) -> None:
    """Full, graded, free, unstable and symmetric structures, at resonances and grazing too."""
    found = [one for seed in seeds for one in truth.compared(seed)[0]]
    assert len(found) > 150
    assert [one for one in found if not one.within] == []
    moved = [one for one in found if one.size]
    relative = np.array([one.wrong / one.size for one in moved])
    assert np.median(relative) < 1e-15
    # What is left is small against what it is the difference of, as its error states.
    assert all(one.stated > 1e-10 * one.size for one in moved if one.wrong > 1e-10 * one.size)
    assert np.median([one.over for one in moved]) <= 100.0


def test_repeated_frequencies() -> None:
    """Two equal masses joined by springs so that two of three modes have one frequency."""
    K = np.array([[3.0, -1.0, -1.0], [-1.0, 3.0, -1.0], [-1.0, -1.0, 3.0]])
    entry = np.zeros((3, 3))
    entry[0, 1] = entry[1, 0] = 1.0
    by = Parameter("K.0.1", K=MatrixRate(entries=SymmetricMatrix.dense(entry)))
    system = System(
        SymmetricMatrix.diagonal(np.ones(3)), SymmetricMatrix.dense(K), (Constraint.at(0, 0.5),)
    )
    result = solved(problem(system, np.array([1.7, 2.4]), by))
    for place, Omega in enumerate([1.7, 2.4]):
        data = differences.Data.of(np.eye(3), K, None, np.eye(3)[:1], [(0.5, 0.5)], Omega)
        true = differences.derivative(data, differences.Change(K=entry), (-0.7, 0.3))
        for name in ("impulse", "shape", "waveform", "energy"):
            values = getattr(result, f"derivative_{name}")[place, ..., 0].ravel()
            stated = getattr(result, f"derivative_{name}_error")[place, ..., 0].ravel()
            wrong = np.abs(values - true[name])
            assert (wrong <= stated).all()
            assert wrong.max() <= 1e-13 * np.abs(true[name]).max()


def test_a_finite_element_beam() -> None:
    """The gap scales all of a solution; stiffness and frequency together scale time."""
    system = beams.cantilever(25, damped=False)
    Omega = beams.OMEGA * np.array([1.1, 1.9])
    result = solved(problem(system, Omega, GAP, STIFFNESS, FREQUENCY))
    for name, power in (("shape", 1), ("waveform", 1), ("harmonics", 1), ("energy", 2)):
        values = getattr(result, f"derivative_{name}")
        wrong = getattr(result, f"derivative_{name}_error")
        scaled = power * getattr(result, name) / beams.GAP
        slack = wrong[..., 0] + 1e-13 * np.abs(scaled).max()
        assert (np.abs(values[..., 0] - scaled) <= slack).all()
        # x(a K, sqrt(a) Omega) = x(K, Omega), and the energy goes with a.
        half = 0.5 * Omega.reshape(-1, *[1] * (values.ndim - 2))
        shifted = values[..., 1] + half * values[..., 2]
        grown = result.energy if name == "energy" else 0.0
        assert result.energy is not None
        slack = wrong[..., 1] + half * wrong[..., 2] + 1e-12 * np.abs(scaled).max() * beams.GAP
        assert (np.abs(shifted - grown) <= slack).all()


def test_harmonics_by_differences() -> None:
    """Also at a resonance of a mode with a harmonic, and with unequal gaps."""
    h = 1e-6
    for lower in (0.2, 0.25):
        at = [
            System(
                chain().M,
                chain().K.plus(step, chain().K),
                (Constraint((5,), (1.0,), lower, 0.2),),
            )
            for step in (0.0, -h, h)
        ]
        Omega = np.array([2.0 * np.sin(np.pi / 28.0) * 5.0, 1.4])
        result, below, above = (solved(problem(each, Omega, STIFFNESS)) for each in at)
        assert above.harmonics is not None
        assert below.harmonics is not None
        assert result.derivative_harmonics is not None
        difference = (above.harmonics - below.harmonics) / (2.0 * h)
        size = np.abs(difference).max()
        assert np.abs(result.derivative_harmonics[..., 0] - difference).max() < 1e-7 * size


def test_gaps_that_become_unequal_turn_the_motion() -> None:
    """Upper and lower impulses differ in their derivatives where they are equal themselves."""
    upper = Parameter("upper", "length", stops=(StopRate(0, upper=1.0),))
    lower = Parameter("lower", "length", stops=(StopRate(0, lower=1.0),))
    result = solved(problem(chain(), np.array([1.4]), upper, lower, GAP))
    plus, minus = result.derivative_impulse, result.derivative_impulse_lower
    assert plus is not None
    assert minus is not None
    assert plus[0, 0, 0] == pytest.approx(minus[0, 0, 1], rel=1e-12)
    assert plus[0, 0, :2].sum() == pytest.approx(plus[0, 0, 2], rel=1e-12)
    assert abs(plus[0, 0, 0] - minus[0, 0, 0]) > 0.1 * abs(plus[0, 0, 2])


def test_no_derivative_where_there_is_no_impulse() -> None:
    """Two free masses: momentum balances, the impulse is none at any frequency."""
    K = SymmetricMatrix.dense([[1.0, -1.0], [-1.0, 1.0]])
    both = (Constraint.at(0, 1.0), Constraint.at(1, 1.0))
    system = System(SymmetricMatrix.diagonal([1.0, 1.0]), K, both)
    # Both reach their walls together: S has the rows of one motion only where cos gamma = 0.
    result = solved(problem(system, np.array([np.sqrt(2.0)]), GAP))
    assert result.derivative_reason is not None
    assert result.derivative_impulse is not None
    if result.derivative_reason[0, 0]:
        assert np.isnan(result.derivative_impulse).all()
    else:
        assert np.isfinite(result.derivative_impulse).all()


def test_blocks_and_pieces_agree_to_the_bit() -> None:
    """Also rates that differ from frequency to frequency."""
    rates = np.linspace(0.5, 1.5, 40)
    one = Parameter("each", "time-1", frequency=rates)
    whole = problem(chain(), np.linspace(1.5, 4.0, 40), one, GAP)
    plan = impact_modes.plan(whole)
    result = impact_modes.solve(whole, plan)
    parts = [impact_modes.solve(whole.slice(*pair), plan) for pair in ((0, 17), (17, 40))]
    joined = impact_modes.join(whole, plan, parts)
    assert np.array_equal(result.derivative_momentum, joined.derivative_momentum)
    assert np.array_equal(result.derivative_shape_error, joined.derivative_shape_error)
    plain = solved(problem(chain(), np.linspace(1.5, 4.0, 40), FREQUENCY))
    assert result.derivative_momentum is not None
    assert plain.derivative_momentum is not None
    scaled = plain.derivative_momentum[..., 0] * rates[:, np.newaxis]
    assert np.allclose(result.derivative_momentum[..., 0], scaled, rtol=1e-13)


def test_the_answers_stay_what_they_are() -> None:
    """Derivatives change no bit of the outputs, and the plan names their price."""
    Omega = np.linspace(1.5, 4.0, 20)
    with_them, without = problem(chain(), Omega, GAP), problem(chain(), Omega)
    first, second = solved(with_them), solved(without)
    for name in ("impulse", "shape", "waveform", "energy", "harmonics", "impulse_error"):
        assert np.array_equal(getattr(first, name), getattr(second, name))
    step = impact_modes.plan(with_them).step(Stage.DERIVATIVES)
    assert step is not None
    assert step.flops > 0.0
    plan = impact_modes.plan(without)
    assert plan.step(Stage.DERIVATIVES) is None
    assert "derivatives" in {skip.what for skip in plan.skips}
    assert second.derivative_momentum is None


def test_parameters_are_checked() -> None:
    with pytest.raises(ModelError, match="number 0") as caught:
        problem(chain(), np.array([1.4]), GAP, GAP)
    assert caught.value.pointer == ("derivatives", 1)
    many = tuple(replace(GAP, path=f"gap{k}") for k in range(1001))
    with pytest.raises(ModelError, match="1001 parameters"):
        problem(chain(), np.array([1.4]), *many)
