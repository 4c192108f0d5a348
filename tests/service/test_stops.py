"""Stops with stiffness and damping through the client: documents, tables, files, sweeps, plots."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest

import vibroimpact as vi
from vibroimpact.errors import InvalidRequest

START = ([0.0] * 3, [1.0, 0.0, -0.5])
COLUMNS = {
    "start", "rest", "stop", "constraint", "side", "velocity", "impulse", "peak_force",
    "indentation", "energy_lost",
}  # fmt: skip


def chain(**law: Any) -> Any:
    law = {"stiffness": 100.0, "damping": 1.0} | law
    return vi.chain(3, [vi.constraint(0, 0.3, **law)])


@pytest.mark.needs("compiled kernels")
def test_the_default_request(tmp_path: Path) -> None:
    """x, v, energy and force at the output times, and the contacts, each with errors."""
    motion = vi.Local().time_history(chain(), START, 20.0, t=101)
    assert motion.force.shape == motion.error.force.shape == (101, 1)
    assert set(motion.to_xarray("contacts").data_vars) == COLUMNS
    assert motion.contacts.start.size > 3
    assert (motion.error.contacts.peak_force < 1e-9 * motion.contacts.peak_force).all()
    assert motion.to_xarray()["force"].dims == ("t", "constraint")
    lost = motion.energy[0] - motion.energy[-1]
    assert lost == pytest.approx(motion.contacts.energy_lost.sum(), rel=1e-12)
    mpl.use("agg")
    ax = motion.plot()
    (right,) = (other for other in ax.figure.axes if other is not ax)
    assert right.get_ylabel() == "force of the stop"
    assert vi.Local().time_history(chain(), START, 20.0).plot().lines


@pytest.mark.needs("compiled kernels")
def test_a_sweep_over_the_stiffness_is_its_points_alone() -> None:
    local, values = vi.Local(), [10.0, 100.0, 1e6]
    base = {
        "system": chain(), "initial": {"x": START[0], "v": START[1]}, "t_end": 6.0,
        "t": {"num": 4}, "outputs": ["x", "force", "contacts"],
    }  # fmt: skip
    grid = local.sweep("time-history", base, {"system.constraints.0.law.stiffness": values})
    for place, k in enumerate(values):
        alone = local.time_history(
            chain(stiffness=k), START, 6.0, t=4, outputs=["x", "force", "contacts"]
        )
        np.testing.assert_array_equal(grid.force[place], alone.force)
        np.testing.assert_array_equal(grid.x[place], alone.x)
        assert grid.contact_count[place] == alone.contacts.start.size


@pytest.mark.parametrize(
    ("constraint", "pointer"),
    [
        ({"law": {"type": "linear", "stiffness": -1}}, "/system/constraints/0/law/stiffness"),
        ({"law": {"type": "linear"}}, "/system/constraints/0/law/stiffness"),
        ({"law": {"type": "linear", "stiffness": 1, "damping": -1}},
         "/system/constraints/0/law/damping"),
        ({"law": {"type": "linear", "stiffness": 1, "restitution": 0}},
         "/system/constraints/0/law/restitution"),
        ({"law": {"type": "linear", "stiffness": 1, "damping": 1, "restitution": 0.5}},
         "/system/constraints/0/law"),
        ({"law": {"type": "linear", "stiffness": 1}, "restitution": 0.5}, "/system/constraints/0"),
        ({"law": {"type": "soft"}}, "/system/constraints/0/law"),
        ({"law": {"type": "hertz"}}, "/system/constraints/0/law/stiffness"),
        ({"law": {"type": "hertz", "stiffness": 1, "exponent": 2}},
         "/system/constraints/0/law/exponent"),
        ({"law": {"type": "hertz", "stiffness": -1}}, "/system/constraints/0/law/stiffness"),
        ({"law": {"type": "hertz", "stiffness": 1e300}}, "/system/constraints/0/law/stiffness"),
        ({"law": {"type": "power", "stiffness": 1}}, "/system/constraints/0/law/exponent"),
        ({"law": {"type": "power", "stiffness": 1, "exponent": 0.5}},
         "/system/constraints/0/law/exponent"),
        ({"law": {"type": "power", "stiffness": 1, "exponent": 1e9}},
         "/system/constraints/0/law/exponent"),
        ({"law": {"type": "rigid", "restitution": 2}}, "/system/constraints/0/law/restitution"),
    ],
)  # fmt: skip
def test_wrong_laws_are_named(constraint: dict[str, Any], pointer: str) -> None:
    wrong: Any = vi.chain(3, [{"dof": 0, "gap": 0.3, **constraint}])
    with pytest.raises(InvalidRequest) as refused:
        vi.Local().time_history(wrong, START, 1.0)
    assert [each["pointer"] for each in refused.value.errors] == [pointer]


def test_other_kinds_name_the_law() -> None:
    with pytest.raises(InvalidRequest) as refused:
        vi.Local().impact_modes(chain(), [3.0])
    assert refused.value.errors[0]["pointer"] == "/system/constraints/0/law"


@pytest.mark.needs("compiled kernels")
def test_a_rigid_law_is_a_restitution() -> None:
    law: Any = {"type": "rigid", "restitution": 0.5}
    one = vi.chain(3, [{"dof": 0, "gap": 0.3, "law": law}])
    other = vi.chain(3, [vi.constraint(0, 0.3, 0.5)])
    found, true = (vi.Local().time_history(each, START, 9.0) for each in (one, other))
    np.testing.assert_array_equal(found.impacts.time, true.impacts.time)


def test_a_damping_needs_a_stiffness() -> None:
    with pytest.raises(ValueError, match="needs a stiffness"):
        vi.constraint(0, 0.1, damping=1.0)


@pytest.mark.needs("compiled kernels")
def test_attractors_have_contacts() -> None:
    """Their table, its errors, sections at contacts, files, plots and sweeps."""
    local = vi.Local()
    stop = vi.constraint(0, {"lower": None, "upper": 0.0}, stiffness=100.0)
    structure = vi.oscillator([stop], zeta=0.05)
    load, x, v = [vi.drive(dof=0, amplitude=1.0)], [[-0.5], [-1.0]], [[0.3], [1.0]]
    settled = local.attractors(structure, 2.9, load, x, v, section="impacts")
    assert settled.attractor.contacts.tolist() == [2]
    assert settled.attractor.contact_rate.tolist() == [1.0]
    assert settled.contact.duration.size == 2
    assert (settled.error.contact.duration < 1e-9).all()
    assert settled.section.velocity.size == 2
    mpl.use("agg")
    assert settled.plot().lines
    frame = settled.to_pandas("contact")
    np.testing.assert_array_equal(frame["peak_force"], settled.contact.peak_force)
    base = vi.attractors_request(structure, 2.9, load, x, v)
    over = {"system.constraints.0.law.stiffness": [50.0, 100.0]}
    grid = local.sweep("attractors", base, over)
    assert grid.contact_count[1] == 2
    assert grid.plot().lines


@pytest.mark.needs("compiled kernels")
def test_motions_with_several_contacts() -> None:
    local = vi.Local()
    stop = vi.constraint(0, {"lower": None, "upper": 0.0}, stiffness=100.0)
    structure = vi.oscillator([stop], zeta=0.05)
    load = [vi.drive(dof=0, amplitude=1.0)]
    twice = [(0, "upper"), (0, "upper")]
    motions = local.periodic_motions(structure, [2.9], load, periods=2, sequence=twice)
    exists = motions.solution.exists & (motions.solution.contacts == 2)
    assert exists.any()
    assert motions.frequency.complete.tolist() == ["no"]
    plan = local.plan("periodic-motions", vi.periodic_motions_request(
        structure, [2.9], load, periods=2, sequence=twice
    ))  # fmt: skip
    assert "newton in switchings" in [step["method"] for step in plan["steps"]]


@pytest.mark.needs("compiled kernels")
def test_laws_of_powers_in_requests(tmp_path: Path) -> None:
    """The default request, from a file and again, and as points of a sweep and of an ensemble."""
    local, outputs = vi.Local(), ["x", "force", "contacts"]
    hertz = vi.chain(3, [vi.constraint(0, 0.3, stiffness=200.0, law="hertz"),
                         vi.constraint(2, 0.2, stiffness=50.0)])  # fmt: skip
    motion = local.time_history(hertz, START, 20.0, t=101)
    assert motion.force.shape == motion.error.force.shape == (101, 2)
    assert set(motion.to_xarray("contacts").data_vars) == COLUMNS
    assert set(motion.contacts.constraint) == {0, 1}
    assert np.abs(motion.energy - motion.energy[0]).max() <= 2.0 * motion.error.energy.max()
    stored = vi.TimeHistory(motion.to_hdf5(tmp_path / "hertz.h5"))
    np.testing.assert_array_equal(stored.contacts.impulse, motion.contacts.impulse)
    base = {
        "system": vi.chain(
            3, [vi.constraint(0, 0.3, stiffness=200.0, law="power", exponent=1.5)]
        ),
        "initial": {"x": START[0], "v": START[1]}, "t_end": 6.0, "t": {"num": 4},
        "outputs": outputs,
    }  # fmt: skip
    values = [1.0, 1.5, 2.0, 3.3]
    grid = local.sweep("time-history", base, {"system.constraints.0.law.exponent": values})
    for place, exponent in enumerate(values):
        stop = vi.constraint(0, 0.3, stiffness=200.0, law="power", exponent=exponent)
        alone = local.time_history(vi.chain(3, [stop]), START, 6.0, t=4, outputs=outputs)
        np.testing.assert_array_equal(grid.force[place], alone.force)
        assert grid.contact_count[place] == alone.contacts.start.size
    together = local.ensemble(
        base["system"], [START[0]] * 2, [START[1], [2.0, 0.0, 0.0]], 6.0, t=4, outputs=outputs
    )
    np.testing.assert_array_equal(together.force[0], grid.force[1])


@pytest.mark.parametrize(
    "given",
    [
        {"law": "hertz"}, {"law": "power", "stiffness": 1.0}, {"law": "soft", "stiffness": 1.0},
        {"law": "hertz", "stiffness": 1.0, "exponent": 1.5}, {"stiffness": 1.0, "exponent": 2.0},
        {"law": "hertz", "stiffness": 1.0, "damping": 1.0},
        {"law": "power", "stiffness": 1.0, "exponent": 2.0, "restitution": 0.5},
    ],
)  # fmt: skip
def test_numbers_that_a_law_has_not_are_refused(given: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"law|exponent|stiffness"):
        vi.constraint(0, 0.1, **given)


@pytest.mark.parametrize("kind", ["periodic-motions", "attractors", "impact-modes"])
def test_other_kinds_name_those_that_offer_a_law(kind: str) -> None:
    system = vi.chain(3, [vi.constraint(0, 0.3, stiffness=200.0, law="hertz")])
    local, load = vi.Local(), [vi.drive(0, 1.0)]
    call = {
        "periodic-motions": lambda: local.periodic_motions(system, [0.8], load),
        "attractors": lambda: local.attractors(system, 0.8, load, [START[0]], [START[1]]),
        "impact-modes": lambda: local.impact_modes(system, [3.0]),
    }[kind]
    with pytest.raises(InvalidRequest, match="offered by time-history and ensemble") as refused:
        call()
    assert refused.value.errors[0]["pointer"] == "/system/constraints/0/law"


def walled(**term: Any) -> Any:
    """Return a chain whose wall moves."""
    stop = vi.constraint(0, 0.3, stiffness=20.0, damping=0.5, wall=[{"amplitude": 0.1} | term])
    return vi.chain(3, [stop], damping=0.3)


def test_walls_move_with_the_drive() -> None:
    """A sweep over the amplitude is its points alone; without one the wall is at rest."""
    local, load = vi.Local(), [vi.drive(0, 0.5)]
    request = vi.periodic_motions_request(
        walled(harmonic=1, phase=0.4), [0.8], load, sequence="symmetric"
    )
    path = "system.constraints.0.wall.0.amplitude"
    swept = local.sweep("periodic-motions", request, {path: [0.0, 0.1, 0.2]})
    for k, amplitude in enumerate((0.0, 0.1, 0.2)):
        alone = local.periodic_motions(
            walled(harmonic=1, phase=0.4, amplitude=amplitude),
            [0.8],
            load,
            sequence="symmetric",
        )
        rows = swept.rows("contact", amplitude=amplitude)
        np.testing.assert_array_equal(rows.peak_force, alone.contact.peak_force)
        assert alone.solution.exists.any()
        assert np.abs(alone.solution.work - alone.solution.energy_lost).max() < 1e-12
        if k == 0:
            still = vi.constraint(0, 0.3, stiffness=20.0, damping=0.5)
            at_rest = local.periodic_motions(
                vi.chain(3, [still], damping=0.3), [0.8], load, sequence="symmetric"
            )
            for name in ("duration", "peak_force", "energy_lost"):
                np.testing.assert_array_equal(alone.contact[name], at_rest.contact[name])


@pytest.mark.parametrize(
    ("kind", "term", "pointer", "message"),
    [
        ("periodic", {}, "/frequency", "give one of them"),
        ("periodic", {"frequency": 1.0, "harmonic": 1}, "/frequency", "give one of them"),
        ("periodic", {"frequency": 1.0}, "/frequency", "harmonic of the drive"),
        ("periodic", {"harmonic": 0}, "/harmonic", "greater than or equal to 1"),
        ("history", {"harmonic": 1}, "/harmonic", "no drive's harmonic"),
        ("attractors", {"harmonic": 1}, "", "time-history and periodic-motions"),
    ],
)
def test_other_terms_of_walls_are_named(
    kind: str, term: dict[str, float], pointer: str, message: str
) -> None:
    local, system, load = vi.Local(), walled(**term), [vi.drive(0, 0.5)]
    x = np.zeros(3)
    call = {
        "periodic": lambda: local.periodic_motions(system, [0.8], load),
        "history": lambda: local.time_history(system, (x, x), 1.0),
        "attractors": lambda: local.attractors(system, 0.8, load, [x], [x]),
    }[kind]
    with pytest.raises(InvalidRequest, match=message) as refused:
        call()
    where = "/system/constraints/0/wall" + ("/0" if pointer else "")
    assert refused.value.errors[0]["pointer"] == where + pointer
