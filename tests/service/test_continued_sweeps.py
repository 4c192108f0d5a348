"""Continued sweeps: each point starts where the last ended, as in a loop of single requests."""

from __future__ import annotations

import copy
import math
from typing import Any

import numpy as np
import pytest

from vibroimpact_schema.sweeps import SweepRequest
from vibroimpact_service.documents import digest, planning
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.results import encode
from vibroimpact_service.store import Store
from vibroimpact_service.use_case import chunks as job_chunks
from vibroimpact_solvers import sweep
from vibroimpact_solvers.plan import Stage

OSCILLATOR: dict[str, Any] = {
    "preset": "oscillator",
    "Omega0": 1.0,
    "zeta": 0.05,
    "constraints": [{"dof": 0, "gap": {"lower": None, "upper": 0.5}, "restitution": 0.8}],
}
HISTORY: dict[str, Any] = {
    "system": OSCILLATOR,
    "initial": {"x": [0.0], "v": [0.1]},
    "load": [{"dof": 0, "amplitude": 0.4, "frequency": 1.0, "phase": 0.3}],
    "t_end": 20.0,
    "t": {"num": 3},
    "outputs": ["x", "v", "impacts"],
}
SETTLED: dict[str, Any] = {
    "system": OSCILLATOR,
    "load": [{"dof": 0, "amplitude": 0.25}],
    "frequency": {"values": [1.0]},
    "initial": {"x": [[0.0]], "v": [[0.0]]},
    "settle": 60,
    "observe": 40,
}
DOWN = {"path": "load.0.frequency", "start": 1.6, "stop": 0.8, "step": -0.1}
LOSSES = {"path": "system.constraints.0.restitution", "values": [0.6, 0.8]}
UPPER = "system.constraints.0.gap.upper"


def document(kind: str, base: dict[str, Any], *axes: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {"kind": kind, "base": base, "axes": list(axes), "continue": True, **more}


def solved(store: Store, content: dict[str, Any]) -> tuple[sweep.Problem, sweep.Result]:
    request = SweepRequest.model_validate(content)
    _, problem, plan, _ = planning.plan(store, KINDS["sweep"], request)
    return problem, sweep.solve(problem, plan)


def alone(store: Store, kind: str, content: dict[str, Any]) -> Any:
    of = KINDS[kind]
    _, problem, plan, _ = planning.plan(store, of, of.request.model_validate(content))
    return of.solver.solve(problem, plan)


def changed(base: dict[str, Any], path: str, value: float) -> dict[str, Any]:
    content = copy.deepcopy(base)
    *parents, last = [int(part) if part.isdigit() else part for part in path.split(".")]
    here: Any = content
    for part in parents:
        here = here[part]
    here[last] = value
    return content


def loop(store: Store, base: dict[str, Any], path: str, values: Any) -> list[Any]:
    """Return time histories one by one, each from the end of the last, the load turning on."""
    results, initial, turned = [], base["initial"], 0.0
    for value in values:
        content = changed(base, path, float(value))
        t_end, load = content["t_end"], content.get("load", [])
        content |= {"initial": initial, "t": [0.0, 0.5 * t_end, t_end]}
        content["outputs"] = list({*content["outputs"], "x", "v"})
        for term in load:
            term["phase"] = term.get("phase", 0.0) + turned
        results.append(alone(store, "time-history", content))
        initial = {"x": results[-1].x[-1].tolist(), "v": results[-1].v[-1].tolist()}
        if load:
            turned = math.remainder(turned + load[0]["frequency"] * t_end, 2.0 * math.pi)
    return results


def rows(result: sweep.Result, table: str, name: str, index: tuple[int, ...]) -> Any:
    start = int(result.arrays[f"{table}_offset"][index])
    return result.arrays[name][start : start + int(result.arrays[f"{table}_count"][index])]


class TestHistories:
    @pytest.mark.needs("compiled kernels")
    @pytest.mark.parametrize("outputs", [["impacts"], ["x", "v", "impacts"]])
    def test_are_those_of_a_loop(self, store: Store, outputs: list[str]) -> None:
        base = HISTORY | {"outputs": outputs}
        problem, result = solved(store, document("time-history", base, DOWN, LOSSES))
        frequencies = problem.axes[0].values
        np.testing.assert_array_equal(frequencies, [1.6, 1.5, 1.4, 1.3, 1.2, 1.1, 1.0, 0.9, 0.8])
        np.testing.assert_array_equal(result.arrays["status"], 0)
        for j, restitution in enumerate(LOSSES["values"]):
            one = changed(base, str(LOSSES["path"]), restitution)
            expected = loop(store, one, "load.0.frequency", frequencies)
            assert sum(each.impact_time.size for each in expected) >= 15
            for i, each in enumerate(expected):
                for name in ("impact_time", "impact_velocity", "error_impact_time"):
                    found = rows(result, "impact", name, (i, j))
                    assert found.tobytes() == getattr(each, name).tobytes()
                if "x" in outputs:
                    for name in ("x", "v", "error_x"):
                        assert result.arrays[name][i, j].tobytes() == getattr(each, name).tobytes()

    @pytest.mark.needs("compiled kernels")
    def test_move_as_one_motion_where_nothing_changes(self, store: Store) -> None:
        # Five points of 7 time units, no multiple of the drive's period, against one of 35.
        base = HISTORY | {"t_end": 7.0, "t": [7.0]}
        phases = {"path": "load.0.phase", "name": "phase", "values": [0.3] * 5}
        _, result = solved(store, document("time-history", base, phases))
        whole = alone(store, "time-history", HISTORY | {"t_end": 35.0, "t": {"num": 6}})
        np.testing.assert_allclose(result.arrays["x"][:, 0], whole.x[1:], atol=1e-11)
        time = np.repeat(7.0 * np.arange(5), result.arrays["impact_count"])
        np.testing.assert_allclose(
            time + result.arrays["impact_time"], whole.impact_time, atol=1e-11
        )

    @pytest.mark.needs("compiled kernels")
    @pytest.mark.parametrize(
        "more",
        [
            {"limiter": {"law": "power", "exponent": 5.0}},
            {"method": "DOP853"},
            {"digits": 30, "tolerance": 1e-14},
            {"dofs": [0], "t": [20.0], "outputs": ["x"]},
        ],
    )
    def test_of_all_methods_are_those_of_a_loop(self, store: Store, more: dict[str, Any]) -> None:
        base = HISTORY | more
        both = {"lower": 0.5, "upper": 0.5}  # a power law needs two walls
        base = base | {"system": changed(OSCILLATOR, "constraints.0.gap", both)}  # type: ignore[arg-type]
        values = [0.9, 1.1, 1.3]
        axis = {"path": "load.0.frequency", "values": values}
        _, result = solved(store, document("time-history", base, axis))
        expected = loop(store, base, "load.0.frequency", values)
        for i, each in enumerate(expected):
            last = result.arrays["x"][i, -1]
            assert last.tobytes() == each.x[-1].tobytes()

    @pytest.mark.needs("compiled kernels")
    def test_beyond_stops_of_finite_stiffness_go_on(self, store: Store) -> None:
        spring = {"dof": 0, "gap": 0.5, "law": {"type": "linear", "stiffness": 50.0}}
        base = HISTORY | {"system": OSCILLATOR | {"constraints": [spring]}, "t_end": 3.0}
        base["outputs"] = ["x", "v", "contacts"]
        values = [0.5, 0.3, 0.1, 0.02]
        _, result = solved(
            store,
            document("time-history", base, {"path": "system.constraints.0.gap", "values": values}),
        )
        for i, each in enumerate(loop(store, base, "system.constraints.0.gap", values)):
            assert result.arrays["x"][i, -1].tobytes() == each.x[-1].tobytes()
        ends = result.arrays["x"][:-1, -1, 0]
        assert (np.abs(ends) > values[1:]).any()  # one begins in the stop that was moved in

    @pytest.mark.needs("compiled kernels")
    def test_repeat_sampled_loads(self, store: Store) -> None:
        base = HISTORY | {
            "load": [{"dof": 0, "force": [0.0, 1.0, -0.5, 0.2, 0.0], "interval": 5.0}]
        }
        axis = {"path": "system.zeta", "values": [0.1, 0.1, 0.02]}
        _, result = solved(store, document("time-history", base, axis))
        initial = base["initial"]
        for i, zeta in enumerate(axis["values"]):
            content = changed(base, "system.zeta", zeta) | {"initial": initial}
            each = alone(store, "time-history", content)
            assert result.arrays["x"][i].tobytes() == each.x.tobytes()
            initial = {"x": each.x[-1].tolist(), "v": each.v[-1].tolist()}

    @pytest.mark.needs("compiled kernels")
    def test_of_what_has_no_mass_follow_the_new_stiffness(self, store: Store) -> None:
        system = {
            "M": {"diagonal": [1.0, 0.0]},
            "K": [[2.0, -1.0], [-1.0, 3.0]],
            "constraints": [{"dof": 0, "gap": 0.5, "restitution": 0.8}],
        }
        base = {
            "system": system, "initial": {"x": [0.3, 0.0], "v": [1.0, 0.0]}, "t_end": 4.0,
            "t": [0.0, 4.0], "outputs": ["x", "v"],
        }  # fmt: skip
        values = [3.0, 4.0, 5.0]
        _, result = solved(
            store, document("time-history", base, {"path": "system.K.1.1", "values": values})
        )
        x = result.arrays["x"]
        np.testing.assert_array_equal(result.arrays["status"], 0)
        np.testing.assert_array_equal(x[1:, 0, 0], x[:-1, 1, 0])
        np.testing.assert_allclose(x[:, :, 1] * np.array(values)[:, np.newaxis], x[:, :, 0])

    @pytest.mark.needs("compiled kernels")
    def test_that_rest_at_a_stop_go_on_there(self, store: Store) -> None:
        floor = {"dof": 0, "gap": {"lower": 0.0, "upper": None}, "restitution": 0.5}
        base = {
            "system": {"preset": "bouncing_ball", "g": 9.81, "constraints": [floor]},
            "initial": {"x": [0.3], "v": [0.0]}, "t_end": 2.0, "t": [0.0, 2.0],
            "outputs": ["x", "v", "impacts", "contacts"],
        }  # fmt: skip
        axis = {"path": "system.g", "values": [9.81, 12.0, 5.0]}
        _, result = solved(store, document("time-history", base, axis))
        np.testing.assert_array_equal(result.arrays["status"], 0)
        np.testing.assert_array_equal(result.arrays["x"][1:], 0.0)
        assert result.arrays["impact_count"].tolist()[1:] == [0, 0]
        for i in (1, 2):
            assert rows(result, "contact", "contact_stop", (i,)).tolist() == [2.0]

    @pytest.mark.needs("compiled kernels")
    def test_that_cannot_start_are_left_out(self, store: Store) -> None:
        # The stop is moved in beyond where the last motion ended, and out again.
        gaps = [0.5, -0.9, 0.5]
        axis = {"path": UPPER, "values": gaps}
        _, result = solved(store, document("time-history", HISTORY, axis))
        assert result.arrays["status"].tolist() == [0, 1, 0]
        (why,) = result.plain["error/failures"]
        assert "upper = -0.9: " in why
        assert "outside of its limits" in why
        assert np.isnan(result.arrays["x"][1]).all()
        expected = loop(store, HISTORY, UPPER, [0.5, 0.5])
        assert result.arrays["x"][2].tobytes() == expected[1].x.tobytes()


class TestAttractors:
    @pytest.mark.needs("compiled kernels")
    def test_are_those_of_a_loop(self, store: Store) -> None:
        axis = {"path": "frequency.values.0", "start": 1.5, "stop": 1.0, "num": 6}
        problem, result = solved(store, document("attractors", SETTLED, axis))
        content = copy.deepcopy(SETTLED)
        assert (result.arrays["attractor_count"] == 1).all()
        assert 0 < (result.arrays["attractor_impacts"] > 0).sum() < 6
        for i, Omega in enumerate(problem.axes[0].values):
            content["frequency"] = {"values": [float(Omega)]}
            each = alone(store, "attractors", content)
            for name in ("attractor_x", "attractor_period", "attractor_exponent"):
                assert result.arrays[name][[i]].tobytes() == getattr(each, name).tobytes()
            for name in ("section_x", "section_v"):
                assert (
                    rows(result, "section", name, (i,)).tobytes() == getattr(each, name).tobytes()
                )
            content["initial"] = {
                "x": each.attractor_x.tolist(),
                "v": each.attractor_v.tolist(),
            }

    @pytest.mark.needs("compiled kernels")
    def test_go_on_from_within_a_stop_that_yields(self, store: Store) -> None:
        """At the drive's phase 0 the stop is loaded: the mass is beyond its wall, and stays."""
        spring = {"type": "linear", "stiffness": 10.0}
        wall = {"dof": 0, "gap": {"lower": None, "upper": -0.5}, "law": spring}
        # So little damping that 32 periods show where the motion began.
        system = SETTLED["system"] | {"zeta": 1e-4, "constraints": [wall]}
        base = SETTLED | {"system": system, "settle": 0, "observe": 32}
        axis = {"path": "load.0.amplitude", "values": [0.5, 0.6]}
        _, result = solved(store, document("attractors", base, axis))
        first = alone(store, "attractors", changed(base, "load.0.amplitude", 0.5))
        end = {"x": [first.section_x[-1].tolist()], "v": [first.section_v[-1].tolist()]}
        assert first.section_x[-1, 0] > -0.4
        content = changed(base | {"initial": end}, "load.0.amplitude", 0.6)
        second = alone(store, "attractors", content)
        for i, each in enumerate((first, second)):
            mine = rows(result, "section", "section_x", (i,))
            np.testing.assert_allclose(mine, each.section_x, rtol=0.0, atol=1e-9)

    @pytest.mark.needs("compiled kernels")
    def test_of_several_motions_go_on_motion_by_motion(self, store: Store) -> None:
        axis = {"path": "frequency.values.0", "values": [1.15, 1.2, 1.25]}
        states = [(0.0, 0.0), (0.0, -1.5), (0.3, 1.0)]

        def of(*some: tuple[float, float]) -> sweep.Result:
            initial = {"x": [[x] for x, _ in some], "v": [[v] for _, v in some]}
            return solved(store, document("attractors", SETTLED | {"initial": initial}, axis))[1]

        together = of(*states)
        assert together.arrays["settled_period"].shape == (3, 3)
        for row, state in enumerate(states):
            single = of(state)
            for name in ("settled_period", "settled_exponent", "settled_status"):
                mine = together.arrays[name][:, row]
                assert mine.tobytes() == single.arrays[name][:, 0].tobytes()

    @pytest.mark.needs("compiled kernels")
    def test_up_and_down_differ_as_the_closed_form_says(self, store: Store) -> None:
        # The motion without impacts reaches the stop where its amplitude, of one mass, is the gap.
        gap, F, zeta = 0.5, 0.25, 0.05
        base = SETTLED | {"settle": 100}
        grid = {"start": 1.0, "stop": 1.6, "num": 13}
        up = solved(store, document("attractors", base, {"path": "frequency.values.0", **grid}))[1]
        grid |= {"start": 1.6, "stop": 1.0}
        down = solved(store, document("attractors", base, {"path": "frequency.values.0", **grid}))[
            1
        ]
        Omega = np.linspace(1.0, 1.6, 13)
        amplitude = F / np.hypot(1.0 - Omega**2, 2.0 * zeta * Omega)
        strikes = [each.arrays["attractor_impacts"] > 0 for each in (up, down)]
        np.testing.assert_array_equal(strikes[1][::-1], amplitude > gap)
        held = strikes[0] & (amplitude < gap)
        assert held.any()  # on the way up the impacts go on where a motion at rest would not strike
        assert not strikes[0][-1]

    @pytest.mark.needs("compiled kernels")
    def test_a_motion_that_cannot_start_waits(self, store: Store) -> None:
        base = SETTLED | {"initial": {"x": [[0.0], [0.4]], "v": [[0.0], [0.0]]}}
        axis = {"path": UPPER, "values": [0.5, -2.0, 0.5]}
        _, result = solved(store, document("attractors", base, axis))
        assert result.arrays["settled_status"].tolist() == [[0, 0], [1, 1], [0, 0]]
        assert result.arrays["attractor_impacts"].size


class TestPieces:
    @pytest.mark.needs("compiled kernels")
    @pytest.mark.parametrize("kind", ["time-history", "attractors"])
    def test_are_cut_along_the_other_axes_only(
        self, store: Store, kind: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(job_chunks, "CHUNK_SECONDS", 1e-9)
        base = HISTORY if kind == "time-history" else SETTLED
        first = {"path": "load.0.amplitude", "values": [0.2, 0.4, 0.3]}
        content = document(kind, base, first, LOSSES)
        named = {}
        for continued in (True, False):
            request = SweepRequest.model_validate(content | {"continue": continued})
            data = digest.canonical(request)
            name = digest.content(data)
            store.requests.put(name, data)
            named[continued] = name, job_chunks.split(store.url, "sweep", name, "ab" * 32)
        name, chunks = named[True]
        assert len(chunks) == 2
        assert len(named[False][1]) == 6
        assert {c.name for c in chunks}.isdisjoint(c.name for c in named[False][1])
        for k in (1, 0):  # in any order
            job_chunks.solve(store.url, "sweep", name, "ab" * 32, [k])
        job_chunks.join(store.url, "sweep", name, "ab" * 32, chunks)
        joined = encode.unpack(store.results.get("ab" * 32) or b"").arrays
        _, whole = solved(store, content)
        assert list(joined) == list(whole.arrays)
        for key, values in whole.arrays.items():
            assert joined[key].tobytes() == values.tobytes(), key

    def test_with_an_axis_alone_are_one(self, store: Store) -> None:
        request = SweepRequest.model_validate(document("time-history", HISTORY, DOWN))
        _, problem, plan, _ = planning.plan(store, KINDS["sweep"], request)
        assert [piece.spans for piece in sweep.split(problem, plan, 1e-9)] == [((0, 9),)]


def test_plans_count_the_motion_to_the_end(store: Store) -> None:
    def step(content: dict[str, Any]) -> Any:
        plan = planning.plan(store, KINDS["sweep"], SweepRequest.model_validate(content)).plan
        return plan.step(Stage.FREE_MOTION)

    shown, bare = HISTORY, HISTORY | {"outputs": ["impacts"]}
    plain = step(document("time-history", bare, DOWN) | {"continue": False})
    linked = step(document("time-history", bare, DOWN))
    assert linked.flops == 2.0 * plain.flops
    assert "along frequency each point starts where the last ended" in linked.reason
    assert "where it ends is computed beside its outputs" in linked.reason
    whole = step(document("time-history", shown, DOWN))
    assert whole.flops == step(document("time-history", shown, DOWN) | {"continue": False}).flops


def test_requests_that_say_no_are_those_that_say_nothing() -> None:
    content = document("time-history", HISTORY, DOWN)
    silent = {key: value for key, value in content.items() if key != "continue"}
    said = [
        digest.canonical(SweepRequest.model_validate(each))
        for each in (silent, content | {"continue": False}, content)
    ]
    assert said[0] == said[1] != said[2]
    assert b'"continue":true' in said[2]
    assert SweepRequest.model_validate_json(said[2]).root.continue_


class TestRefusals:
    def test_of_kinds_without_an_end(self) -> None:
        base = {"system": OSCILLATOR}
        content = document("resonances", base, {"path": UPPER, "values": [0.4, 0.5]})
        with pytest.raises(
            ValueError, match="only sweeps of attractors and time-history"
        ) as caught:
            SweepRequest.model_validate(content)
        (error,) = caught.value.errors()  # type: ignore[attr-defined]
        assert error["loc"] == ("resonances", "continue")

    def test_of_initial_states_along_the_first_axis(self, store: Store) -> None:
        axis = {"path": "initial.v.0", "values": [0.1, 0.2]}
        request = SweepRequest.model_validate(document("time-history", HISTORY, axis))
        with pytest.raises(ProblemError) as caught:
            planning.plan(store, KINDS["sweep"], request)
        (fault,) = caught.value.errors
        assert (fault.pointer, fault.code) == ("/axes/0/path", "not_continued")
        second = SweepRequest.model_validate(document("time-history", HISTORY, DOWN, axis))
        assert planning.plan(store, KINDS["sweep"], second).plan.points == 18

    @pytest.mark.parametrize(
        ("step", "message"),
        [
            (0.1, "stop lies below start: the step must be negative"),
            (0.0, "must not be 0"),
        ],
    )
    def test_of_steps_away_from_the_stop(self, step: float, message: str) -> None:
        with pytest.raises(ValueError, match=message) as caught:
            SweepRequest.model_validate(document("time-history", HISTORY, DOWN | {"step": step}))
        (error,) = caught.value.errors()  # type: ignore[attr-defined]
        assert error["loc"] == ("time-history", "axes", 0, "@steps", "step")
