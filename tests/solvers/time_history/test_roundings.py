"""Roundings that would add up: in frequencies, modes and impacts that are the same every time."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest

from tests.truth import histories
from vibroimpact_solvers import presets, spectrum
from vibroimpact_solvers import time_history as th
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.time_history.structure import Structure

GAP = 0.2
EPS, FINE = np.finfo(np.float64).eps, np.finfo(np.longdouble).eps


def exact(value: mp.mpf, part: float) -> mp.mpf:
    """Return a number less its first part."""
    return value - mp.mpf(part)


def test_frequencies_keep_what_rounding_takes_from_them() -> None:
    system = presets.chain(13, [Constraint.at(5, GAP)])
    structure = Structure.of(system, spectrum.Method.CLOSED_FORM, 1.0)
    basis = structure.configuration().basis
    nu, rest = basis.flow.nu[basis.place], basis.flow.rest[basis.place]
    with mp.workdps(40):
        for j in range(13):
            true = 2 * mp.sin(mp.pi * (j + 1) / 28) / structure.scale
            assert abs((exact(true, nu[j]) - mp.mpf(rest[j])) / true) <= 4.0 * max(FINE, EPS**2)


def test_modes_of_a_chain_are_rounded_once() -> None:
    n, worst = 40, mp.mpf(0)
    modes = spectrum.spectrum(presets.chain(n, [Constraint.at(5, GAP)])).modes
    with mp.workdps(40):
        factor = mp.sqrt(mp.mpf(2) / (n + 1))
        for i in range(n):
            for j in range(n):
                true = factor * mp.sin(mp.pi * (i + 1) * (j + 1) / (n + 1))
                if abs(true) > 1e-20:
                    worst = max(worst, abs(exact(true, modes[i, j])) / np.spacing(abs(modes[i, j])))
    assert worst <= 0.5 + 4.0 * FINE / EPS


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize(
    ("n", "dof", "factor", "periods"), [(50, 20, 1.7, 100), (100, 49, 1.5, 250)]
)
def test_elastic_impacts_take_no_energy(n: int, dof: int, factor: float, periods: int) -> None:
    """On an impact mode all roundings are the same each time, and so is what they take.

    A rounding of every impulse took 1e-15 of the speed within ten impacts, and with it the time.
    """
    system = presets.chain(n, [Constraint.at(dof, GAP)])
    Omega = factor * spectrum.spectrum(system).largest_frequency
    problem = th.Problem(system, th.ImpactMode(Omega), periods * 2.0 * np.pi / Omega)
    result = th.solve(problem, th.plan(problem))
    assert result.impact_velocity is not None
    assert result.impact_time is not None
    assert result.count_impacts == 2 * periods
    speeds, times = np.abs(result.impact_velocity), result.impact_time
    assert abs(speeds[-1] / speeds[0] - 1.0) <= 1e-14
    late = times[-1] - times[0] - (times[1] - times[0]) * (speeds.size - 1)
    # An error of the first interval, 2e-16 or so, counts as often as there are impacts.
    assert abs(late) <= 1e-14 * speeds.size


def test_prepared_motions_tell_no_errors_where_none_are_estimated() -> None:
    system = presets.chain(13, [Constraint.at(5, GAP)])
    state = th.State(np.zeros(13), np.ones(13))
    outputs = frozenset({"impacts", "x"})
    found = {}
    for estimate in (True, False):
        problem = th.Problem(
            system, state, 30.0, t=np.array([30.0]), outputs=outputs, estimate=estimate
        )
        found[estimate] = th.prepare(problem, th.plan(problem)).solve()
    some, none = found[True], found[False]
    assert some.impact_condition is not None
    assert none.impact_condition is not None
    assert none.impact_condition.size == none.count_impacts == some.count_impacts > 0
    assert np.isnan(none.impact_condition).all()
    assert np.isnan(none.error_condition)
    assert np.isnan(none.error_predictable_until)
    assert (some.impact_condition > 0.0).all()
    assert some.error_condition >= some.impact_condition.max()
    np.testing.assert_array_equal(none.impact_time, some.impact_time)
    np.testing.assert_array_equal(none.x, some.x)


def test_a_motion_that_passes_a_saddle_keeps_its_energy() -> None:
    """What decays on the way to the saddle is what grows after the next impact.

    K < 0: from wall to wall over the top of a potential, 40 times e-fold down and up again.
    """
    document = {
        "M": [[1.0]], "K": [[-0.1]],
        "constraints": [{"dofs": [0], "weights": [1.0], "lower": 115.5, "upper": 115.5,
                         "restitution": 1.0}],
        "x": [0.163], "v": [-0.239], "t": [50.0, 84.0, 120.0], "t_end": 125.0,
    }  # fmt: skip
    report = histories.checked(document)
    assert report.counts["horizon at the end"] == 1


@pytest.mark.parametrize("drag", [1e-2, 1e-5, 1e-8])
def test_a_body_slides_to_the_last_digits(drag: float) -> None:
    """A body without spring, and the faintest of drags: it moves a small part of its way."""
    M, x, v, t = 2.5, -0.157, -0.0973, np.array([0.0, 2.0, 6.07, 20.8])
    system = System(
        SymmetricMatrix.diagonal([M]), SymmetricMatrix.diagonal([0.0]), (),
        C=SymmetricMatrix.diagonal([drag]),
    )  # fmt: skip
    start, outputs = th.State(np.array([x]), np.array([v])), frozenset({"x"})
    problem = th.Problem(system, start, 21.0, t=t, outputs=outputs)
    result = th.solve(problem, th.plan(problem))
    assert result.x is not None
    with mp.workdps(40):
        rate = mp.mpf(drag) / mp.mpf(M)
        true = [mp.mpf(x) - mp.mpf(v) * mp.expm1(-rate * mp.mpf(float(each))) / rate for each in t]
        places = [mp.mpf(float(place)) for place in result.x[:, 0]]
        off = np.array([float(a - b) for a, b in zip(true, places, strict=True)])
    assert (np.abs(off) <= 8.0 * EPS * np.abs(result.x[:, 0]).max()).all()


@pytest.mark.parametrize("drag", [1e-2, 1e-5, 1e-8, 1e-12])
@pytest.mark.parametrize("bodies", [1, 2])
def test_a_body_falls_through_the_faintest_drag(drag: float, bodies: int) -> None:
    """Its terminal velocity is far away; of positions that counted from there, no digit was left.

    What is claimed of it does not depend on the drag, and holds.
    """
    M = np.diag([1.0, 2.5][:bodies])
    document = {
        "M": M.tolist(), "K": np.zeros_like(M).tolist(), "C": (drag * M).tolist(),
        "constraints": [{"dofs": [0], "weights": [1.0], "lower": 0.0, "upper": None,
                         "restitution": 0.8}],
        "force": [-9.81, 0.3][:bodies], "x": [1.0, 0.2][:bodies], "v": [0.3, -0.1][:bodies],
        "t": [0.4, 1.1, 2.0], "t_end": 2.1,
    }  # fmt: skip
    report = histories.checked(document)
    assert report.counts["horizon at the end"] == 1
    problem = histories.problem_of(document)
    assert th.solve(problem, th.plan(problem)).error_condition < 5e3


@pytest.mark.parametrize("drag", [1e-2, 1e-5, 1e-8, 1e-12])
def test_a_body_swings_through_the_faintest_drag(drag: float) -> None:
    """What a harmonic load moves is the difference of the two rates, 0 and that of the drag."""
    document = {
        "M": [[2.5]], "K": [[0.0]], "C": [[drag]],
        "constraints": [{"dofs": [0], "weights": [1.0], "lower": 50.0, "upper": None,
                         "restitution": 0.8}],
        "load": [[0, -1.05, 0.29, 2.09], [0, 0.51, 5.3, -0.4]], "x": [-0.17], "v": [-0.28],
        "t": [0.27, 0.7, 1.4, 2.2, 9.0], "t_end": 9.5,
    }  # fmt: skip
    histories.checked(document)
    problem = histories.problem_of(document)
    assert th.solve(problem, th.plan(problem)).error_condition < 3e3


def test_errors_are_those_of_their_own_time() -> None:
    """Two bounces on a hill: what is stated before the first is not what the last one makes."""
    system = System(
        SymmetricMatrix.diagonal([1.0]), SymmetricMatrix.diagonal([-1.0]),
        (Constraint((0,), (1.0,), 1.0, 1.0, 1.0),),
    )  # fmt: skip
    start, t = th.State(np.array([0.0]), np.array([2.0])), np.linspace(0.1, 12.0, 60)
    outputs = frozenset({"x", "v", "impacts"})
    problem = th.Problem(system, start, 12.0, t=t, outputs=outputs)
    result = th.solve(problem, th.plan(problem))
    assert result.error_x is not None
    assert result.error_impact_time is not None
    assert result.error_x[0, 0] < 0.1 * result.error_x[-1, 0]
    assert (np.diff(result.error_x[:, 0]) >= 0.0).all()
    for until in (4.0, 8.0):
        shorter = th.Problem(system, start, until, t=t[t < until], outputs=outputs)
        part = th.solve(shorter, th.plan(shorter))
        assert part.error_x is not None
        np.testing.assert_allclose(
            result.error_x[: part.error_x.size], part.error_x, rtol=0.8, atol=0.0
        )


@pytest.mark.parametrize("drag", [1e-2, 1e-5, 1e-8])
def test_a_sampled_load_pushes_a_body_through_the_faintest_drag(drag: float) -> None:
    """The two rates of the body, 0 and -2 delta, differ by all that it moves."""
    system = System(
        SymmetricMatrix.diagonal([1.0]), SymmetricMatrix.diagonal([0.0]), (),
        C=SymmetricMatrix.diagonal([drag]),
    )  # fmt: skip
    load = th.Sampled(np.ones(1), np.array([0.0, 1.0, 4.0]), np.array([0.5, 0.5, 2.0]))
    start, t = th.State(np.zeros(1), np.zeros(1)), np.array([0.5, 1.0, 3.0])
    problem = th.Problem(system, start, 3.5, t=t, outputs=frozenset({"x"}), load=(load,))
    result = th.solve(problem, th.plan(problem))
    assert result.x is not None
    with mp.workdps(40):
        rate = mp.mpf(drag)

        def place(time: float) -> mp.mpf:
            def answer(s: mp.mpf) -> mp.mpf:
                force = mp.mpf("0.5") if s <= 1 else mp.mpf("0.5") + (s - 1) / 2
                return force * -mp.expm1(-rate * (time - s)) / rate

            return mp.quad(answer, [0, min(time, 1.0), time])

        off = [
            float(mp.mpf(float(x)) - place(float(s)))
            for s, x in zip(t, result.x[:, 0], strict=True)
        ]
    assert (np.abs(off) <= 8.0 * EPS * np.abs(result.x[:, 0]).max()).all()


@pytest.mark.needs("compiled kernels")
def test_to_and_fro_between_close_walls() -> None:
    """Thousands of crossings, each of which depends on the places of both walls."""
    gap = 0.00027322615469776757
    histories.checked({
        "M": [[0.4696589094852107, 0.0], [0.0, 2.9896302974445463]],
        "K": [[2.4097465728989405, -1.878398313991948], [-1.878398313991948, 2.198756540848892]],
        "constraints": [
            {"dofs": [0], "weights": [1.0], "lower": gap, "upper": gap, "restitution": 1.0}
        ],
        "x": [0.0, 0.0], "v": [-0.35266818105702297, -1.2077940576112178],
        "t": [2.0814583143067575], "t_end": 6.927950026533554,
    })  # fmt: skip


def test_a_body_that_drag_alone_holds_keeps_its_velocity() -> None:
    """Coupled by damping; its deflection is 10^4 times its motion, and none of it is velocity."""
    histories.checked({
        "M": np.diag([1.2333424293331072, 2.920044959822832, 1.2260822267715947,
                      1.3478383951548638]).tolist(),
        "K": [[0.4150390625, -0.4150390625, 0.0, 0.0],
              [-0.4150390625, 1.12890625, -0.712890625, 0.0],
              [0.0, -0.712890625, 2.40234375, -1.6884765625],
              [0.0, 0.0, -1.6884765625, 1.6884765625]],
        "C": [[1.2698898255462414, 0.0, -1.2698898255462414, 0.0], [0.0, 0.0, 0.0, 0.0],
              [-1.2698898255462414, 0.0, 1.2698898255462414, 0.0],
              [0.0, 0.0, 0.0, 0.003794030773869299]],
        "constraints": [{"dofs": [0], "weights": [1.0], "lower": 6.352957048057459, "upper": None,
                         "restitution": 1.0}],
        "x": [-0.5689002196938985, -0.00962827095559945, -0.5267790908383406, -0.10659973564314909],
        "v": [5.575146790570703, -1.773247238655238, -3.0543782345044193, 4.195442714162594],
        "force": [2.837683295324664, 4.99787733971395, -1.0377634851671762, 2.1444028377220836],
        "load": [[0, 1.9474925535308092, 0.7996949549615372, -2.5618171398605885]],
        "t": [0.8], "t_end": 0.9,
    })  # fmt: skip


@pytest.mark.needs("compiled kernels")
def test_a_body_that_grows_into_its_wall_bounces_a_thousand_times() -> None:
    """Where hops begin is a rounding of a large state, and lengthens each of them (k = 1)."""
    histories.checked({
        "M": [[1.0, -0.006195569935425975], [-0.006195569935425975, 0.926298253614473]],
        "K": [[-0.2384631114731478, 0.3295661419459889], [0.3295661419459889, 0.5848377475093737]],
        "constraints": [{"dofs": [1], "weights": [1.0], "lower": 3.515684387159249,
                         "upper": 3.515684387159249, "restitution": 1.0}],
        "x": [-0.022257302363126064, -0.15502664139349565],
        "v": [-0.1352108977739789, 0.3375360507728172],
        "t": [15.915125226235645, 25.086538791215176, 25.244418444879113],
        "t_end": 26.474437169451623,
    })  # fmt: skip


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize(
    ("m", "k", "gap", "v"),
    [(0.6205243985892677, 1.3598929845617143, 0.0009591443688309724, 7.421020880562266),
     (1.7, 0.9, 0.064, 3.0),
     (0.8, 1.1, 0.31, 1.9)],
)  # fmt: skip
def test_four_thousand_impacts_at_one_wall_are_off_by_a_few_roundings(
    m: float, k: float, gap: float, v: float
) -> None:
    """All are alike, and so would be what rounding takes from their times."""
    limiter = Constraint((0,), (1.0,), None, gap, 1.0)
    system = System(SymmetricMatrix.diagonal([m]), SymmetricMatrix.diagonal([k]), (limiter,))
    with mp.workdps(40):
        w = mp.sqrt(mp.mpf(k) / mp.mpf(m))
        first = mp.asin(w * mp.mpf(gap) / mp.mpf(v)) / w
        period, back = mp.pi / w + 2 * first, mp.sqrt(mp.mpf(v) ** 2 - (w * mp.mpf(gap)) ** 2)
        t = np.array([float(first + (n + 0.37) * period) for n in (10, 100, 1000, 4000)])
        state = th.State(np.array([0.0]), np.array([v]))
        problem = th.Problem(system, state, t[-1], t=t, outputs=frozenset({"x"}))
        result = th.solve(problem, th.plan(problem))
        assert result.count_impacts == 4001
        assert result.x is not None
        assert result.error_x is not None
        for place, when in enumerate(t.tolist()):
            since = mp.fmod(mp.mpf(when) - first, period)
            true = mp.mpf(gap) * mp.cos(w * since) - back / w * mp.sin(w * since)
            off = abs(true - mp.mpf(float(result.x[place, 0])))
            assert off <= result.error_x[place, 0]
            assert off <= 3e-13 * v / w
