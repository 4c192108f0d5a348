"""Axes of a sweep find their fields, take only values that are possible, and have good names."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vibroimpact_schema.sweeps import SweepRequest
from vibroimpact_service.documents import planning, sweep_axes
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store
from vibroimpact_solvers import sweep
from vibroimpact_solvers.errors import ModelError, Status

MATRICES: dict[str, Any] = {
    "M": {"diagonal": [1.0, 2.0]},
    "K": [[2.0, -1.0], [-1.0, 2.0]],
    "constraints": [{"dof": 0, "gap": {"lower": 0.1, "upper": 0.2}}],
}


FULL: dict[str, Any] = MATRICES | {"M": [[1.0, 0.0], [0.0, 2.0]]}


def document(*axes: dict[str, Any], system: dict[str, Any] = MATRICES, **more: Any) -> Any:
    base = {"system": copy.deepcopy(system), "frequency": {"values": [2.0, 3.0]}}
    return {"kind": "impact-modes", "base": base, "axes": list(axes), **more}


def problem(store: Store, content: Any) -> sweep.Problem:
    request = SweepRequest.model_validate(content)
    found: sweep.Problem = planning.plan(store, KINDS["sweep"], request).problem
    return found


def refused(store: Store, content: Any) -> tuple[str, str, str]:
    """Return pointer, code and message of the refusal."""
    with pytest.raises(ProblemError) as caught:
        problem(store, content)
    assert caught.value.type.status == 422
    (fault,) = caught.value.errors
    return fault.pointer, fault.code, fault.message


class TestPaths:
    @pytest.mark.parametrize(
        ("path", "code", "message"),
        [
            ("system.constraints.0.gaps", "unknown_path", "no 'gaps' in system.constraints.0"),
            ("system.constraints.1.gap", "unknown_path", "no '1' in system.constraints"),
            ("sistem.K.0.0", "unknown_path", "no 'sistem' in the base"),
            ("system.K.0.0.0", "unknown_path", "no '0' in system.K.0.0"),
            ("system.force.0", "unknown_path", "no '0' in system.force; it is not given"),
            ("system.K.0", "not_a_number", "a list"),
            ("system.constraints.0.gap", "not_a_number", "an object"),
            ("system.units", "not_a_number", "null"),
            ("frequency.unit", "not_a_number", "text"),
        ],
    )
    def test_that_lead_to_no_number(self, store: Store, path: str, code: str, message: str) -> None:
        pointer, found, said = refused(store, document({"path": path, "values": [1.0]}))
        assert (pointer, found) == ("/axes/0/path", code)
        assert message in said

    def test_that_lead_to_one_number_twice(self, store: Store) -> None:
        axes = [{"path": path, "values": [-1.0]} for path in ("system.K.0.1", "system.K.1.0")]
        assert refused(store, document(*axes))[:2] == ("/axes/1/path", "duplicate_path")

    def test_to_defaults_that_were_not_written(self, store: Store) -> None:
        content = document({"path": "system.constraints.0.restitution", "values": [0.5, 1.0]})
        point = problem(store, content).at((0,))
        assert point.system.constraints[0].restitution == 0.5

    def test_of_an_entry_of_a_matrix_take_its_mirror_image_along(self, store: Store) -> None:
        content = document({"path": "system.K.0.1", "values": [-0.5, 0.25]})
        K = problem(store, content).at((1,)).system.K.to_dense()
        np.testing.assert_array_equal(K, [[2.0, 0.25], [0.25, 2.0]])

    def test_of_an_entry_of_a_list_of_entries_take_its_mirror_image_along(
        self, store: Store
    ) -> None:
        K = {"shape": [2, 2], "row": [0, 1, 0, 1], "col": [0, 1, 1, 0], "data": [2, 3, -1, -1]}
        content = document(
            {"path": "system.K.data.3", "values": [-0.5]},
            {"path": "system.K.data.1", "values": [4.0]},
            system=MATRICES | {"K": K},
        )
        found = problem(store, content).at((0, 0)).system.K.to_dense()
        np.testing.assert_array_equal(found, [[2.0, -0.5], [-0.5, 4.0]])

    def test_of_bands_reach_both_sides(self, store: Store) -> None:
        content = document(
            {"path": "system.K.bands.1.0", "values": [-0.5]},
            system=MATRICES | {"K": {"bands": {"0": [2, 2], "1": [-1]}}},
        )
        found = problem(store, content).at((0,)).system.K.to_dense()
        np.testing.assert_array_equal(found, [[2.0, -0.5], [-0.5, 2.0]])

    def test_to_integers_take_integers(self, store: Store) -> None:
        dofs = {"path": "system.constraints.0.dof", "values": [0, 1]}
        assert problem(store, document(dofs)).at((1,)).system.constraints[0].dofs == (1,)
        half = {"path": "system.constraints.0.dof", "values": [0, 0.5]}
        assert refused(store, document(half))[:2] == ("/axes/0/values/1", "wrong_type")


class TestValues:
    def test_that_a_field_may_not_have(self, store: Store) -> None:
        axis = {"path": "system.constraints.0.restitution", "values": [1.0, 1.5]}
        pointer, code, message = refused(store, document(axis))
        assert (pointer, code) == ("/axes/0/values/1", "out_of_range")
        assert "system.constraints.0.restitution = 1.5" in message

    def test_of_a_range_that_a_field_may_not_have(self, store: Store) -> None:
        axis = {"path": "frequency.values.0", "start": -1, "stop": 1, "step": 0.5}
        pointer, code, message = refused(store, document(axis))
        assert (pointer, code) == ("/axes/0", "out_of_range")
        assert "frequency.values.0 = -1.0" in message

    def test_that_leave_no_room_between_walls(self, store: Store) -> None:
        axis = {"path": "system.constraints.0.gap.upper", "values": [0.3, -0.1]}
        pointer, code, message = refused(store, document(axis))
        assert (pointer, code) == ("/axes/0/values/1", "gap_not_positive")
        assert "-0.1" in message

    def test_that_make_the_mass_matrix_indefinite(self, store: Store) -> None:
        axis = {"path": "system.M.diagonal.1", "start": 1.0, "stop": -1.0 + 2.0, "num": 1}
        assert problem(store, document(axis)).shape == (1,)
        axis = {"path": "system.M.diagonal.1", "values": [1.0, 0.0]}
        assert problem(store, document(axis)).shape == (2,)  # without mass it follows
        axis = {"path": "system.M.diagonal.1", "values": [1.0, -1.0]}
        pointer, code, _ = refused(store, document(axis))
        assert (pointer, code) == ("/axes/0/values/1", "not_positive_definite")

    def test_that_are_wrong_only_together_are_refused_where_nothing_is_possible(
        self, store: Store
    ) -> None:
        lower = {"path": "system.constraints.0.gap.lower", "values": [-0.5, 0.1]}
        upper = {"path": "system.constraints.0.gap.upper", "values": [0.1, 0.2]}
        pointer, code, _ = refused(store, document(lower, upper))
        assert (pointer, code) == ("/axes/0/values/0", "gap_not_positive")

    def test_that_are_wrong_at_some_points_leave_these_without_result(self, store: Store) -> None:
        lower = {"path": "system.constraints.0.gap.lower", "values": [-0.15, 0.1]}
        upper = {"path": "system.constraints.0.gap.upper", "values": [0.1, 0.2]}
        found = problem(store, document(lower, upper))
        result = sweep.solve(found, sweep.plan(found))
        np.testing.assert_array_equal(result.arrays["status"], [[Status.INVALID, 0], [0, 0]])
        assert np.isnan(result.arrays["impulse"][0, 0]).all()
        assert np.isfinite(result.arrays["impulse"][0, 1]).all()
        (sentence,) = result.plain["error/failures"]
        assert sentence.startswith("gap_lower = -0.15, gap_upper = 0.1:")
        assert "leave no room" in sentence

    def test_of_steps_are_the_decimals_one_would_write(self, store: Store) -> None:
        axis = {"path": "system.constraints.0.gap.upper", "start": 0.1, "stop": 0.8, "step": 0.1}
        (found,) = problem(store, document(axis)).axes
        assert found.values.tolist() == [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8]
        assert found.offset == 1

    def test_of_shifted_steps_are_the_same_numbers(self, store: Store) -> None:
        def values(start: float, stop: float) -> list[float]:
            path = "system.constraints.0.gap.upper"
            axis = {"path": path, "start": start, "stop": stop, "step": 0.007}
            (found,) = problem(store, document(axis)).axes
            return found.values.tolist()

        whole, shifted = values(0.007, 0.7), values(0.217, 0.7)
        assert shifted == whole[30:]

    def test_that_change_the_number_of_frequencies(self, store: Store) -> None:
        content = document({"path": "frequency.stop", "values": [3.0, 4.0]})
        content["base"]["frequency"] = {"start": 2.0, "stop": 3.0, "step": 0.5}
        pointer, code, _ = refused(store, content)
        assert (pointer, code) == ("/axes/0/values/1", "shapes_differ")

    def test_that_would_fill_the_memory(self, store: Store) -> None:
        content = document({"path": "frequency.step", "values": [0.5, 1e-15]})
        content["base"]["frequency"] = {"start": 2.0, "stop": 3.0, "step": 0.5}
        assert refused(store, content)[:2] == ("/axes/0/values/1", "shapes_differ")
        chain = {"preset": "chain", "n": 3, "constraints": [{"dof": 0, "gap": 1.0}]}
        content = document({"path": "system.n", "values": [3, 1e15]}, system=chain)
        assert refused(store, content)[:2] == ("/axes/0/path", "shapes_differ")


class TestNames:
    def names(self, store: Store, *axes: dict[str, Any], **more: Any) -> list[str]:
        return [axis.name for axis in problem(store, document(*axes, **more)).axes]

    def test_are_the_ends_of_paths(self, store: Store) -> None:
        paths = ["system.K.0.0", "system.constraints.0.gap.lower", "frequency.values.1"]
        axes = [{"path": path, "values": [2.0]} for path in paths]
        assert self.names(store, *axes) == ["K_0_0", "gap_lower", "frequency_values_1"]

    def test_are_as_long_as_it_takes(self, store: Store) -> None:
        system = MATRICES | {"constraints": [{"dof": 0, "gap": 0.1}, {"dof": 1, "gap": 0.2}]}
        axes = [{"path": f"system.constraints.{i}.gap", "values": [1.0]} for i in range(2)]
        assert self.names(store, *axes, system=system) == ["constraints_0_gap", "constraints_1_gap"]

    def test_can_be_chosen(self, store: Store) -> None:
        axis = {"path": "system.K.0.0", "name": "spring", "values": [2.0]}
        assert self.names(store, axis) == ["spring"]

    @pytest.mark.parametrize("name", ["impulse", "frequency", "error", "status", "digest"])
    def test_of_results_cannot_be_chosen(self, store: Store, name: str) -> None:
        axis = {"path": "system.K.0.0", "name": name, "values": [2.0]}
        assert refused(store, document(axis))[:2] == ("/axes/0/name", "duplicate_name")


class TestBase:
    def test_must_be_valid_in_itself(self, store: Store) -> None:
        content = document({"path": "system.K.0.0", "values": [2.0]})
        content["base"]["active"] = [3]
        assert refused(store, content)[:2] == ("/base/active/0", "index_out_of_range")
        content = document({"path": "system.K.0.0", "values": [2.0]})
        content["base"]["system"]["K"] = [[1.0, 2.0], [3.0, 4.0]]
        assert refused(store, content)[:2] == ("/base/system/K", "not_symmetric")

    def test_outputs_of_the_sweep_replace_its_own(self, store: Store) -> None:
        content = document({"path": "system.K.0.0", "values": [2.0]}, outputs=["energy"])
        assert problem(store, content).at((0,)).outputs == {"energy"}
        content["outputs"] = ["waveform"]
        assert refused(store, content)[:2] == ("/base/tau", "missing_tau")

    def test_may_refer_to_a_stored_system(self, store: Store) -> None:
        name = "sys_" + "0" * 64
        store.systems.put(name, b'{"M":[[1.0]],"K":[[1.0]],"constraints":[{"dof":0,"gap":1.0}]}')
        axis = {"path": "system.constraints.0.gap", "values": [0.5]}
        found = problem(store, document(axis, system={"id": name}))
        assert found.at((0,)).system.constraints[0].upper == 0.5
        missing = document(axis, system={"id": "sys_" + "1" * 64})
        assert refused(store, missing)[:2] == ("/base/system/id", "unknown_system")


@pytest.mark.parametrize("count", [64, 65, 1000])
def test_extremes_of_many_values_are_tried(store: Store, count: int) -> None:
    values = np.linspace(0.0, 1.0, count).tolist()
    problem(store, document({"path": "system.M.0.1", "values": values}, system=FULL))
    values[-1] = 2.5
    pointer, code, _ = refused(
        store, document({"path": "system.M.0.1", "values": values}, system=FULL)
    )
    assert pointer == f"/axes/0/values/{count - 1}"
    assert code == "not_positive_definite"


def of_two_masses(n: int, *values: float) -> Any:
    """Return a sweep over two entries of the mass matrix of a structure whose others are few."""
    bands = {str(k): [-0.01 if k else 10.0] * (n - k) for k in range(40)}
    places = [(0, 1), (1, 0), (1, 2), (2, 1)]
    rows, columns = [*range(n), *(i for i, _ in places)], [*range(n), *(j for _, j in places)]
    system = {
        "M": {
            "shape": [n, n], "row": rows, "col": columns,
            "data": [1.0] * n + [0.5] * 4,
        },
        "K": {"bands": bands},
        "constraints": [{"dof": 0, "gap": 1.0}],
    }  # fmt: skip
    axes = [
        {"path": f"system.M.data.{n + 2 * k}", "values": list(values), "name": name}
        for k, name in enumerate("ab")
    ]
    return document(*axes, system=system)


@pytest.mark.parametrize("n", [200, 1500])
def test_a_sweep_is_not_refused_for_the_few_points_that_are_tried(store: Store, n: int) -> None:
    """Only the extremes of both axes are tried of the large structure, and all of them fail."""
    grid = problem(store, of_two_masses(n, -0.9, 0.0, 0.9))
    statuses = []
    for index in ((0, 0), (0, 1), (2, 2)):
        try:
            grid.at(index)
            statuses.append("ok")
        except ModelError as error:
            statuses.append(error.code)
    assert statuses == ["not_positive_definite", "ok", "not_positive_definite"]


def test_a_sweep_of_a_large_structure_without_any_point(store: Store) -> None:
    pointer, code, message = refused(store, of_two_masses(1500, 2.0, 3.0, 4.0))
    assert (pointer, code) == ("/base/system/M", "not_positive_definite")
    assert message.startswith("at all points that were tried: ")


def test_the_search_for_a_point_that_is_possible_is_bounded(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sweep_axes, "_ALL_TRIED", (1, 1))  # so that the plan looks for it
    request = SweepRequest.model_validate(of_two_masses(200, *np.linspace(2.0, 3.0, 40).tolist()))
    settings = Settings(data=Path(store.url), plan_seconds=0.02)
    with pytest.raises(ProblemError, match="The plan alone takes more than"):
        planning.plan(store, KINDS["sweep"], request, settings)
