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
    "start", "rest", "stop", "constraint", "side", "impulse", "peak_force", "indentation",
    "energy_lost",
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
