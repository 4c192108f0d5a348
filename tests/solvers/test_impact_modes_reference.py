"""Impact modes against the numbers of the book chapter, recomputed in extended precision."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest

from vibroimpact_solvers import impact_modes, presets
from vibroimpact_solvers.impact_modes import Problem, Result
from vibroimpact_solvers.model import Constraint, System

Reference = Callable[[str, str], dict[str, Any]]

GAP = 0.2
EVERYTHING = frozenset({"impulse", "exists", "reason", "shape", "waveform", "energy"})


def solved(system: System, *, omega: Any = None, Omega: Any = None, tau: Any = (1.0,)) -> Result:
    if Omega is not None:
        Omega = np.atleast_1d(Omega).astype(float)
        omega = Omega * (2 / np.pi)
    problem = Problem(
        system,
        np.atleast_1d(omega).astype(float),
        outputs=EVERYTHING,
        tau=np.asarray(tau, dtype=float),
        Omega=Omega,
    )
    return impact_modes.solve(problem, impact_modes.plan(problem))


def numbers(texts: Any) -> np.ndarray:
    return np.array(texts, dtype=float)


def check_solution(system: System, entry: Mapping[str, Any], relative: float = 1e-12) -> None:
    """Compare one solution with its impulses, displacements and energy."""
    values = entry["values"]
    omega = float(entry["parameters"]["omega"])
    result = solved(system, omega=omega, tau=numbers(list(values["X_at_tau"])))
    np.testing.assert_allclose(result.impulse[0], numbers(values["p"]), rtol=relative)
    x = numbers(list(values["X_at_tau"].values()))
    close = {"rtol": relative, "atol": relative * abs(x).max()}
    np.testing.assert_allclose(result.waveform[0], x, **close)
    np.testing.assert_allclose(result.shape[0], x[-1], **close)
    assert result.energy[0] == pytest.approx(float(values["total_energy"]), rel=relative)
    assert bool(result.exists[0]) is values["real_motion"]


def check_family(system: System, values: Mapping[str, Any], *impulses: str) -> None:
    """Compare impulses, and whether the solutions exist, along a family."""
    result = solved(system, Omega=numbers(list(values)))
    p = numbers([[value[name] for name in impulses] for value in values.values()])
    error = np.abs(result.impulse - p).max(axis=1) / np.abs(p).max(axis=1)
    assert (error <= 1e-13 + 10 * result.relative_error).all()
    assert (error <= 1e-12).all()
    assert result.exists.tolist() == [value["real_motion"] for value in values.values()]


class TestOscillator:
    """Eq. 10.5-10.12."""

    system = presets.oscillator([Constraint.at(0, 1.0)], 1.0)

    def test_bilateral_solution(self, reference: Reference) -> None:
        values = reference("impact_modes", "01")["values"]
        omega = float(values["omega"])
        phase = (omega * numbers(list(values["x"])) + 1) % 4 - 1
        tau = np.where(phase > 1, 2 - phase, phase)
        result = solved(self.system, omega=omega, tau=tau)
        assert result.impulse[0, 0] == pytest.approx(float(values["p"]), rel=1e-13)
        assert result.energy[0] == pytest.approx(float(values["E"]), rel=1e-13)
        x = numbers(list(values["x"].values()))
        np.testing.assert_allclose(result.waveform[0, :, 0], x, rtol=1e-13)
        assert result.exists[0]

    @pytest.mark.parametrize(("name", "root"), [("02", "gamma2"), ("03", "gamma"), ("04", "gamma")])
    def test_phantom_roots(self, reference: Reference, name: str, root: str) -> None:
        values = reference("impact_modes", name)["values"]
        result = solved(self.system, omega=1 / float(values[root]))
        assert result.impulse[0, 0] == pytest.approx(float(values["p"]), rel=1e-12)
        assert not result.exists[0]

    @pytest.mark.parametrize("name", ["05", "06", "07"])
    def test_unilateral(self, reference: Reference, name: str) -> None:
        """Eq. 10.11-10.12, whose period is 2/omega: half the omega and twice the p of here."""
        entry = reference("impact_modes", name)
        values, gap = entry["values"], float(entry["parameters"]["Delta"])
        system = presets.oscillator([Constraint((0,), (1.0,), None, gap)], 1.0)
        # Between two impacts tau here runs from -1 to 1, there from 0 to 1 and back.
        tau = 1 - 2 * (1 - numbers(list(values["X_at_tau"])))
        result = solved(system, omega=2 * float(values["omega"]), tau=tau)
        assert 2 * np.pi / result.Omega[0] == pytest.approx(float(values["T"]), rel=1e-14)
        assert result.impulse[0, 0] == pytest.approx(2 * float(values["p"]), rel=1e-13)
        assert result.impulse_lower[0, 0] == 0.0
        x = numbers(list(values["X_at_tau"].values()))
        np.testing.assert_allclose(result.waveform[0, :, 0], x, rtol=1e-13)
        assert result.energy[0] == pytest.approx(float(values["E"]), rel=1e-13)
        assert bool(result.exists[0]) is values["real_motion"]


class TestTwoMasses:
    """Eq. 10.22-10.29."""

    system = presets.two_mass([Constraint.at(0, GAP)], 1.0)

    def test_family(self, reference: Reference) -> None:
        check_family(self.system, reference("impact_modes", "13")["values"], "p1")

    @pytest.mark.parametrize("name", ["15", "16"])
    def test_solution(self, reference: Reference, name: str) -> None:
        check_solution(self.system, reference("impact_modes", name))

    def test_impulse_changes_sign_at_the_pole(self, reference: Reference) -> None:
        pole = float(reference("impact_modes", "14")["values"]["Omega_pole"])
        p = solved(self.system, Omega=[pole * (1 - 1e-9), pole * (1 + 1e-9)]).impulse[:, 0]
        assert p[0] > 1e6
        assert p[1] < -1e6


class TestDoublePendulum:
    """Eq. 10.30-10.40."""

    system = presets.double_pendulum([Constraint.at(0, 0.1)], 2.0)

    def test_family(self, reference: Reference) -> None:
        check_family(self.system, reference("impact_modes", "17")["values"]["p1_at_Omega"], "p1")

    @pytest.mark.parametrize("name", ["18", "19"])
    def test_solution(self, reference: Reference, name: str) -> None:
        check_solution(self.system, reference("impact_modes", name))

    def test_ratio_of_the_angles(self, reference: Reference) -> None:
        ratios = reference("impact_modes", "20")["values"]["ratio_at_omega"]
        shape = solved(self.system, omega=numbers(list(ratios))).shape
        np.testing.assert_allclose(
            shape[:, 1] / shape[:, 0], numbers(list(ratios.values())), rtol=1e-14
        )


class TestChain:
    """Eq. 10.60-10.66; mass 6 of the book is dof 5."""

    system = presets.chain(13, [Constraint.at(5, GAP)])

    def test_family(self, reference: Reference) -> None:
        check_family(self.system, reference("impact_modes", "24")["values"]["p6_at_Omega"], "p6")

    @pytest.mark.needs("compiled kernels")
    def test_poles_of_the_impulse(self, reference: Reference) -> None:
        for text in reference("impact_modes", "25")["values"]["Omega_zeros"]:
            pole = float(text)
            p = solved(self.system, Omega=[pole * (1 - 1e-10), pole * (1 + 1e-10)]).impulse[:, 0]
            assert p[0] > 0 > p[1]

    @pytest.mark.parametrize("name", ["26", "27", "28", "29", "30"])
    def test_solution(self, reference: Reference, name: str) -> None:
        check_solution(self.system, reference("impact_modes", name))

    def test_close_to_the_split_chain(self, reference: Reference) -> None:
        """Without feedback on the struck mass, eq. 10.71-10.73, the shape is 4.3e-3 away."""
        entry = reference("impact_modes", "31")
        split = numbers(entry["values"]["tau=1"])
        shape = solved(self.system, omega=float(entry["parameters"]["omega"])).shape[0]
        assert np.abs(shape - split).max() == pytest.approx(4.4e-3, abs=2e-4)


class TestTwoConstraints:
    """Eq. 10.54-10.59, 10.77-10.89; masses 5 and 9 of the book are dofs 4 and 8."""

    system = presets.chain(12, [Constraint.at(4, GAP), Constraint.at(8, GAP)])

    def test_family(self, reference: Reference) -> None:
        check_family(self.system, reference("impact_modes", "33")["values"], "p5", "p9")

    def test_solution(self, reference: Reference) -> None:
        check_solution(self.system, reference("impact_modes", "34"))

    @pytest.mark.parametrize("omega", ["5", "50", "1000"])
    def test_high_frequency(self, reference: Reference, omega: str) -> None:
        """Entrywise, though the smallest entries are 1e-14 of the largest."""
        values = reference("impact_modes", "35")["values"][omega]
        result = solved(self.system, omega=float(omega))
        assert result.impulse[0, 0] == pytest.approx(float(values["p5"]), rel=1e-14)
        x = numbers(values["x_tau1_n=3..11"])
        np.testing.assert_allclose(result.shape[0, 2:11], x, rtol=1e-13)
