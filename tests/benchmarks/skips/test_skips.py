"""What plans leave out is left out: counters, not times."""

from __future__ import annotations

import ast
import sys
from collections import defaultdict
from collections.abc import Mapping
from contextlib import ExitStack
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType
from unittest import mock

import pytest

import vibroimpact_solvers
from benchmarks.skips.scene import Scene
from tests.benchmarks.skips.counters import NUMBERS, counted
from tests.benchmarks.skips.scenes import scenes
from vibroimpact_solvers import (
    attractors,
    existence_bands,
    impact_modes,
    periodic_motions,
    slow_flow,
    sweep,
    time_history,
)
from vibroimpact_solvers.plan import Plan, Skip

MODES, ROWS, RESPONSES = "natural modes", "entries of modes", "responses of modes"
EQUATIONS, PATH_CHECKS, MAPS = (
    "impulses by equations",
    "certified path checks",
    "maps of half periods",
)
PLACES, FACTORS, PRODUCTS = "displacements", "factorizations", "products of a matrix"
SURVEYS, BOXES, STRUCTURES = "surveys of bands", "boxes", "structures prepared"
COORDINATES, STATES = "coordinates expanded", "states advanced"
FLOWS, SHAPES = "places of slow flows", "shapes of slow flows"

PATH = frozenset({COORDINATES, STATES, BOXES})
"""Counters that another rounding of a sine may change by a few."""

# What each scene saves: with the plan's skips, and without them.
SAVED: Mapping[str, Mapping[str, tuple[int, int]]] = {
    # 400 frequencies; all outputs want a shape and 33 times of 100 degrees of freedom.
    "only impulses requested, N=100": {
        RESPONSES: (40_000, 80_000),
        ROWS: (100, 40_200),
        PLACES: (0, 400 * 100 * 34),
        PATH_CHECKS: (0, 161),
        FACTORS: (0, 710),
    },
    # The constraint of the chain of 13 masses hears 12 modes.
    "only existence requested, N=13": {
        RESPONSES: ((400 + 2 * 156) * 12, 2 * 400 * 12),
        PLACES: (0, 400 * 13 * 34),
        MAPS: (0, 275),
    },
    "one of 100 degrees of freedom requested": {PLACES: (400 * 33, 400 * 33 * 100)},
    "rows of modes at the constraint alone, full M and K, N=100": {ROWS: (100, 100 + 100 * 100)},
    # That in the middle hears 7 modes.
    "modes with a node at the constraint, N=13 struck in the middle": {
        RESPONSES: (400 * 7, 400 * 13)
    },
    # M once, and the shifts of two cells; two harmonics at each of 250 frequencies.
    "frequencies close together in a sparse structure, N=400": {FACTORS: (3, 501)},
    "one frequency of a sparse structure, N=400": {MODES: (0, 400), FACTORS: (3, 0)},
    "equal gaps and no load": {RESPONSES: (400 * 12, 2 * 400 * 12), EQUATIONS: (0, 2 * 400)},
    "one of two constraints struck": {EQUATIONS: (0, 2 * 400)},
    "existence below Ω_N: impulses that are not positive": {PATH_CHECKS: (186, 300)},
    "existence above Ω_N": {PATH_CHECKS: (0, 300), RESPONSES: (300 * 12, 2 * 300 * 12)},
    # The magnitudes of C times ones, what bounds the reach of the motion, and M times a deflection,
    # whose frequency is a part of the price; C times 13 modes is computed in twice the precision,
    # which is not counted here.
    "a structure with damping": {PRODUCTS: (0, 30), ROWS: (13, 13 + 13 * 13)},
    "stability where the modes exist": {MAPS: (154, 300)},
    "stability that depends on the order of simultaneous impacts": {MAPS: (0, 400)},
    "the same structure requested again": {MODES: (100, 200)},
    # 13 degrees of freedom of all solutions that are evaluated.
    "bands that are searched, N=13": {PLACES: (0, 32_188)},
    "bands that are proved, N=13": {RESPONSES: (0, 47_856), PATH_CHECKS: (0, 757), SURVEYS: (4, 0)},
    "bands above the spectrum, N=13": {SURVEYS: (0, 1), BOXES: (0, 3)},
    "bands of one of two constraints struck": {EQUATIONS: (0, 8054), PATH_CHECKS: (0, 3308)},
    "bands without stiffness": {PATH_CHECKS: (2, 4032)},
    "stability of bands that depends on the order of impacts": {MAPS: (0, 33)},
    "only bands requested": {MAPS: (0, 213), NUMBERS: (40, 125)},
    "only their stability requested": {NUMBERS: (49, 125)},
    # Seven numbers of each of 12 frequencies over 1, 3, 5, 7, 9.
    "odd harmonics alone, N=13": {NUMBERS: (7 * 12 * 5, 7 * 12 * 9)},
    "a structure of which half is not joined to the constraint, N=26": {MODES: (12, 12 + 25)},
    "a constraint that the energy does not reach, N=13": {COORDINATES: (34, 65)},
    "thirteen constraints, few of them in reach": {COORDINATES: (449, 1937)},
    # Five deviations, once: one free motion.
    "a motion that has no impact any more, N=13": {COORDINATES: (0, 10), STATES: (5, 14)},
    "soft limiters": {STRUCTURES: (1, 2), STATES: (0, 80)},
    # x and v of 13 degrees of freedom at 301 times, each with its error.
    "only impacts requested, N=13": {PLACES: (0, 301 * 13 * 2), STATES: (80, 80 + 301)},
    "only displacements requested, N=13": {
        PLACES: (301 * 13, 301 * 13 * 2),
        NUMBERS: (8140, 16_678),
    },
    "one of 13 degrees of freedom requested": {PLACES: (301 * 2, 301 * 13 * 2)},
    # One state instead of six at the end of each free motion.
    "no estimate of errors requested, N=13": {STATES: (321, 381)},
    # The rates of 301 times 13 displacements, and their errors; why some are none, and how far.
    "no derivatives of a time history requested, N=13": {NUMBERS: (8140, 16_268)},
    # Of 30 frequencies and 48 solutions, 18 of them with an impact: 13 degrees of freedom, 26
    # multipliers, 33 times.
    "only exists of periodic motions requested, N=13": {NUMBERS: (642, 31_120)},
    "only energy of periodic motions requested, N=13": {NUMBERS: (690, 31_120)},
    "only section of attractors requested": {NUMBERS: (58, 62)},
    "only stability of attractors requested": {NUMBERS: (57, 62)},
    "fifty gaps of two coupled constraints, N=40": {
        MODES: (40, 50 * 40),
        RESPONSES: (400 * 40, 50 * 400 * 40),
    },
    "twenty gaps of a time history, N=40": {MODES: (40, 20 * 40), STRUCTURES: (1, 20)},
    "twenty restitutions of impact modes": {
        MODES: (40, 20 * 40),
        RESPONSES: (400 * 40, 20 * 400 * 40),
    },
    "twenty restitutions of internal resonances": {MODES: (39, 20 * 39)},
    "twenty influences of impact modes": {
        MODES: (40, 20 * 40),
        RESPONSES: (400 * 40, 20 * 400 * 40),
    },
    "twenty restitutions of natural frequencies": {MODES: (40, 20 * 40)},
    "the five lowest modes of a sparse structure, N=400": {MODES: (0, 400)},
    "only natural frequencies requested, N=40": {NUMBERS: (30, 872)},
    "no derivatives of natural frequencies requested, N=40": {ROWS: (0, 1600), NUMBERS: (30, 70)},
    "no derivatives of impact modes requested, N=13": {
        RESPONSES: (400 * 12, 2 * 400 * 12),
        NUMBERS: (3201, 5201),
    },
    "derivatives of impulses, but not of stability, N=13": {
        MODES: (13, 3 * 13),
        MAPS: (275, 3 * 275),
    },
    # One mode an evaluation; an end of an interval takes one more.
    "no interval of a calibration requested": {MODES: (58, 60), ROWS: (4, 6)},
    "64 initial states, N=13": {MODES: (13, 64 * 13), STRUCTURES: (1, 64)},
}

IMPACTS = {
    "damped": 63,
    "two_oscillator": 33,
    "restitution": 47,
    "bouncing_ball": 26,
    "oscillator": 40,
}
"""Of the motions of slow flows, at which the variant is compared with the exact motion."""

SCENES = tuple(scenes())


def saved(scene: Scene) -> Mapping[str, tuple[int, int]]:
    """Return what a scene saves."""
    if scene.solver is not slow_flow:
        return SAVED[scene.name]
    # 300 times, of the variant and of the exact motion.
    if scene.states == ("a second solution for the error",):
        return {FLOWS: (300, 600), SHAPES: (300, 600)}
    shapes = 0 if "x" in scene.states else 300
    return {FLOWS: (300, 600 + IMPACTS[scene.name.split(",")[0]]), SHAPES: (shapes, 600)}


@pytest.mark.parametrize("scene", SCENES, ids=[scene.name for scene in SCENES])
def test_counters(scene: Scene) -> None:
    planned, without, expected = counted(scene.planned), counted(scene.without), saved(scene)
    for found, side in ((planned, 0), (without, 1)):
        for what, pair in expected.items():
            slack = 0.1 if what in PATH else 0.0
            assert found[what] == pytest.approx(pair[side], rel=slack, abs=0), what
    assert any(few < many for few, many in expected.values())


@cache
def sites() -> frozenset[tuple[str, int]]:
    """Return the places in the solvers where something is said to be skipped: file and line."""
    found = set[tuple[str, int]]()
    for path in Path(vibroimpact_solvers.__file__).parent.rglob("*.py"):
        text = path.read_text()
        nodes = ast.walk(ast.parse(text)) if "Skip(" in text else ()
        for node in nodes:
            if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("Skip"):
                found.add((str(path), node.lineno))
    return frozenset(found)


@cache
def planners() -> tuple[ModuleType, ...]:
    """Return the modules that state skips."""
    root = Path(vibroimpact_solvers.__file__).parent.parent
    paths = sorted({Path(path) for path, _ in sites()})
    names = (path.relative_to(root).with_suffix("").parts for path in paths)
    return tuple(import_module(".".join(parts)) for parts in names)


def planned(scene: Scene) -> Plan:
    plan: Plan = scene.solver.plan(scene.problem())
    return plan


def stated(scene: Scene) -> tuple[Plan, dict[str, set[tuple[str, int]]]]:
    """Return the plan of a scene, and where each of its skips was stated."""
    found = defaultdict[str, set[tuple[str, int]]](set)

    def skip(what: str, why: str) -> Skip:
        frame = sys._getframe(1)
        found[what].add((frame.f_code.co_filename, frame.f_lineno))
        return Skip(what, why)

    with ExitStack() as stack:
        for module in planners():
            stack.enter_context(mock.patch.object(module, "Skip", skip))
            for each in vars(module).values():
                if hasattr(each, "cache_clear"):  # what was stated before would not be again
                    each.cache_clear()
        return planned(scene), found


def test_every_skip_that_a_plan_can_state_has_a_scene() -> None:
    shown = set[tuple[str, int]]()
    for scene in SCENES:
        if scene.states:
            plan, places = stated(scene)
            assert {skip.what for skip in plan.skips} >= set(scene.states), scene.name
            shown.update(*(places[what] for what in scene.states))
    # Of outputs that were not requested each one counts, see below.
    assert shown == sites()


@pytest.mark.parametrize(
    "solver",
    [impact_modes, existence_bands, periodic_motions, attractors, time_history, slow_flow],
)
def test_every_output_that_may_not_be_asked_has_a_scene(solver: ModuleType) -> None:
    shown = {what for scene in SCENES if scene.solver is solver for what in scene.states}
    # Reasons come with existence.
    assert shown >= set(solver.OUTPUTS) - {"reason"}


def test_every_reason_why_an_axis_changes_nothing_has_a_scene() -> None:
    rules = {rule.why for kind in sweep.KINDS.values() for rule in kind.rules if rule.stage is None}
    plans = [planned(scene) for scene in SCENES if scene.solver is sweep]
    reasons = [skip.why for plan in plans for skip in plan.skips]
    assert rules
    assert all(any(why.startswith(rule) for why in reasons) for rule in rules)
