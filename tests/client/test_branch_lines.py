"""Lines of branches change at special points; neutral motions have lines of their own."""

from __future__ import annotations

import types
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from matplotlib import pyplot

import vibroimpact as vi
from vibroimpact import plots
from vibroimpact.branch_lines import branch_lines, counted, special_points, stability_of, struck

pytestmark = pytest.mark.needs("processes")

LOCAL = vi.Local()


class Rows(types.SimpleNamespace):
    """A table, in which names of columns are."""

    def __contains__(self, name: str) -> bool:
        return hasattr(self, name)


@pytest.fixture(autouse=True)
def _closed() -> Iterator[None]:
    yield
    pyplot.close("all")


def _branch(stability: list[float], *points: tuple[str, float, int, float], **more: Any) -> Any:
    """Return a branch at parameters 0, 1, … with points: type, parameter, row, along."""
    count = len(stability)
    given: dict[str, Any] = {
        "parameter": np.arange(float(count)), "branch": np.zeros(count, dtype=int),
        "impacts": np.ones(count, dtype=int), "stability": np.array(stability),
    }  # fmt: skip
    columns = [np.array([point[k] for point in points]) for k in range(4)]
    names = dict(zip(("type", "parameter", "solution", "along"), columns, strict=True))
    whole = np.zeros(len(points), dtype=int), np.ones(len(points), dtype=bool)
    table = Rows(**names, branch=whole[0], exists=whole[1])
    return types.SimpleNamespace(solution=Rows(**given | more), points=table, neglected=())


def _lines(result: Any, exists: Any = None) -> list[tuple[str, list[float], list[float]]]:
    rows = result.solution
    there = np.ones(rows.parameter.size, dtype=bool) if exists is None else exists
    lines = branch_lines(result, stability_of(rows), there, 10.0 * rows.parameter)
    return [(line.state, line.x, line.y) for line in lines]


def test_a_line_ends_at_the_flip_and_not_at_a_motion() -> None:
    result = _branch([0.5, 0.9, 1.2, 1.5], ("flip", 1.25, 1, 0.25))
    assert _lines(result) == [
        ("stable", [0.0, 1.0, 1.25], [0.0, 10.0, 12.5]),
        ("unstable", [1.25, 2.0, 3.0], [12.5, 20.0, 30.0]),
    ]


def test_a_line_changes_where_a_contact_is_born() -> None:
    contacts = np.array([1, 1, 2, 2])
    result = _branch([0.5] * 4, ("grazing", 1.25, 1, 0.25), contacts=contacts, impacts=0 * contacts)
    rows, there = result.solution, np.ones(4, dtype=bool)
    lines = [*branch_lines(result, stability_of(rows), there, 10.0 * rows.parameter)]
    assert [(line.count, line.x) for line in lines] == [
        (1, [0.0, 1.0, 1.25]),
        (2, [1.25, 2.0, 3.0]),
    ]
    counts, noun = struck(rows)
    assert [counted(count, noun) for count in (0, *np.unique(counts))] == [
        "no contact",
        "1 contact",
        "2 contacts",
    ]


def test_a_line_reaches_the_fold_beyond_both_motions() -> None:
    turned = np.array([0.0, 1.0, 1.0, 0.0])
    result = _branch([0.5, 0.9, 1.2, 1.5], ("fold", 1.125, 1, 0.5), parameter=turned)
    (before, x, _), (after, other, _) = _lines(result)
    assert (before, after) == ("stable", "unstable")
    assert x == [0.0, 1.0, 1.125]
    assert other == [1.125, 1.0, 0.0]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_flip_and_an_end_beside_each_other_change_the_line_each(sign: float) -> None:
    """In either direction of the branch."""
    there = np.array([True, True, False, False])
    result = _branch([0.5, 0.9, 1.2, 1.5], ("flip", 1.25, 1, 0.25), ("end", 1.75, 1, 0.75))
    expected = [
        ("stable", [0.0, 1.0, 1.25]),
        ("unstable", [1.25, 1.75]),
        ("phantom", [1.75, 2.0, 3.0]),
    ]
    if sign < 0.0:
        points = ("end", -1.75, 1, 0.25), ("flip", -1.25, 1, 0.75)
        back = np.array([-3.0, -2.0, -1.0, 0.0])
        result = _branch([1.5, 1.2, 0.9, 0.5], *points, parameter=back)
        there = there[::-1]
        expected = [(state, [-each for each in x[::-1]]) for state, x in expected[::-1]]
    assert [(state, x) for state, x, _ in _lines(result, there)] == expected


def test_beside_phantoms_stability_changes_at_its_own_point() -> None:
    """A flip of phantoms changes nothing that is seen; without it, the end changes both."""
    ends, flips = ("end", 1.25, 1, 0.25), ("flip", 1.75, 1, 0.75)
    for points in ([ends, flips], [ends]):
        result = _branch([0.5, 0.9, 1.2, 1.5], *points)
        lines = _lines(result, np.array([True, True, False, False]))
        assert [state for state, *_ in lines] == ["stable", "phantom"]
        assert lines[0][1] == [0.0, 1.0, 1.25]


def test_stability_is_lost_at_the_first_point_and_regained_at_the_last() -> None:
    """Two multipliers leave the unit circle, and both return."""
    on = ("flip", 1.25, 1, 0.25), ("torus", 1.75, 1, 0.75)
    (_, lost, _), _ = _lines(_branch([0.5, 0.9, 1.5, 1.5], *on))
    (_, unstable, _), _ = _lines(_branch([1.5, 1.5, 0.9, 0.5], *on))
    assert lost == [0.0, 1.0, 1.25]
    assert unstable == [0.0, 1.0, 1.25, 1.75]


def test_a_branch_that_stops_at_its_flip_has_no_line_of_the_flip() -> None:
    """There the largest multiplier is 1 within its error."""
    neutral = np.array(["no", "no", "yes"])
    lines = _lines(_branch([0.5, 0.9, 1.0], ("flip", 2.0, 1, 1.0), neutral=neutral))
    assert lines[0] == ("stable", [0.0, 1.0, 2.0], [0.0, 10.0, 20.0])
    assert [set(x) for _, x, _ in lines[1:]] == [{2.0}]


def test_without_a_special_point_the_change_is_in_the_middle() -> None:
    lines = _lines(_branch([0.5, 0.9, 1.2], neutral=np.array(["no", "yes", "no"])))
    assert [(state, x) for state, x, _ in lines] == [
        ("stable", [0.0, 0.5]),
        ("neutral", [0.5, 1.0, 1.5]),
        ("unstable", [1.5, 2.0]),
    ]


def test_results_of_0_2_0_have_their_points_at_their_parameters() -> None:
    result = _branch([0.5, 0.9, 1.2], ("flip", 1.25, 1, 0.25))
    del result.points.solution, result.points.along
    (point,) = special_points(result, 10.0 * result.solution.parameter)
    assert (point.row, point.x, point.y) == (1, 1.25, 12.5)


def _followed() -> vi.Branches:
    """Return the branch below a wall at rest, coarsely; its first flip is at 2.65888."""
    stop = vi.constraint(0, {"lower": None, "upper": 0.0}, 0.8)
    system = vi.oscillator([stop], zeta=0.05)
    outputs = ("exists", "stability", "extremes")
    request = vi.periodic_motions_request(system, [2.6], [vi.drive(0, 1.0)], outputs=outputs)
    return LOCAL.branches(request, "frequency.values.0", 2.4, 3.4, switch=0)


def test_no_stable_line_passes_the_flip() -> None:
    result = _followed()
    flip = float(result.points.parameter[result.points.type == "flip"][0])
    assert flip == pytest.approx(2.65888, abs=1e-5)
    ax = result.plot()
    full = [line for line in ax.lines if line.get_linestyle() == "-" and len(line.get_xdata())]
    dashed = [line for line in ax.lines if line.get_linestyle() == "--" and len(line.get_xdata())]
    assert max(np.max(line.get_xdata()) for line in full) == pytest.approx(flip, abs=1e-12)
    assert min(np.min(line.get_xdata()) for line in dashed) == pytest.approx(flip, abs=1e-12)


def test_marks_lie_on_their_lines() -> None:
    result = _followed()
    ax = result.plot()
    (mark,) = [line for line in ax.lines if line.get_label() == "flip"]
    dashed = next(line for line in ax.lines if line.get_linestyle() == "--")
    assert mark.get_xdata()[0] == dashed.get_xdata()[0]
    assert mark.get_ydata()[0] == dashed.get_ydata()[0]


def test_undamped_motions_are_drawn_as_neutral() -> None:
    """Their multipliers are of modulus 1 up to rounding, on either side of it."""
    system = vi.oscillator([vi.constraint(0, 1.0)])
    outputs = ("exists", "stability", "extremes")
    result = LOCAL.periodic_motions(system, (0.3, 0.7, 41), [vi.drive(0, 0.1)], outputs=outputs)
    assert set(stability_of(result.solution)) == {"neutral"}
    labels = [text.get_text() for text in plots.response(result).get_legend().get_texts()]
    assert "neutral" in labels
    assert "unstable" not in labels


def test_the_frequency_energy_plot_says_neutral() -> None:
    chain = vi.chain(13, [vi.constraint(5, 0.2)])
    outputs = ("exists", "energy", "stability")
    ax = LOCAL.impact_modes(chain, (1.9, 4.2, 60), outputs=outputs).plot(output="energy")
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["neutral", "unstable"]


def test_where_the_order_of_impacts_decides_the_energy_plot_claims_nothing() -> None:
    """Stops on two masses that M couples: which is struck first is not known."""
    M, K = np.array([[4.0, 1.0], [1.0, 1.0]]), np.diag([4.0, 1.0])
    system = vi.system(M, K, [vi.constraint(0, 0.2), vi.constraint(1, 0.2)])
    outputs = ("exists", "energy", "stability")
    result = LOCAL.impact_modes(system, (0.3, 6.0, 60), outputs=outputs)
    assert result.exists.any()
    assert np.isnan(result.stability).all()
    ax = result.plot(output="energy")
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert labels == ["stability not known"]
