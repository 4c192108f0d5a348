"""The client against a real service of its own: computing, queueing, reading, drawing."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
import xarray

import vibroimpact as vi
from vibroimpact import plots

mpl.use("Agg")

STRUCTURE = vi.chain(13, [vi.constraint(5, 0.2)])
ALL = ("impulse", "exists", "reason", "shape", "waveform", "energy")


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[vi.Client]:
    with vi.Client(data=tmp_path_factory.mktemp("data")) as opened:
        yield opened


def test_results_are_arrays(client: vi.Client) -> None:
    result = client.impact_modes(STRUCTURE, (0.6, 2.4, 50), outputs=ALL, tau=[0.5, 1.0])
    assert result.impulse.shape == (50, 1)
    assert result.waveform.shape == (50, 2, 13)
    assert result.exists.dtype == bool
    phantoms = set(result.reason[~result.exists])
    assert "negative_impulse" in phantoms
    assert phantoms <= {"negative_impulse", "penetration"}
    assert set(result.reason[result.exists]) == {"ok"}
    assert "Result impact-modes" in repr(result)
    assert "impulse" in result._repr_html_()
    with pytest.raises(AttributeError, match="it has"):
        _ = result.nothing


def test_reduced_models_strike_through_the_service_as_in_a_process(client: vi.Client) -> None:
    """Ten masses in a row, reduced to three modes, and a stop at a mass that is not kept."""
    K = 2.0 * np.eye(10) - np.eye(10, k=1) - np.eye(10, k=-1)
    small = vi.reduce(vi.Model(np.eye(10), K), [], modes=3).model
    stop = small.constraint(6, "x", gap=0.5, stiffness=5.0)
    structure = small.system([stop], damping=0.03, residual_flexibility=True)
    assert structure["residual_flexibility"] is not None
    one, other, stored = (
        each.periodic_motions(given, [0.4], [vi.drive(small.weights(2))])
        for each, given in (
            (client, structure), (vi.Local(), structure), (client, client.store(structure))
        )
    )  # fmt: skip
    assert one.contact.duration.size
    for name in ("duration", "peak_force", "indentation"):
        np.testing.assert_array_equal(one.contact[name], other.contact[name])
        np.testing.assert_array_equal(one.contact[name], stored.contact[name])


def test_files_open_in_xarray(client: vi.Client, tmp_path: Path) -> None:
    result = client.impact_modes(STRUCTURE, (0.6, 2.4, 50), outputs=ALL, tau=[0.5, 1.0])
    path = result.to_hdf5(tmp_path / "result.h5")
    with xarray.open_dataset(path, engine="h5netcdf") as data:
        assert not [name for name in data.dims if str(name).startswith("phony")]
        assert data.attrs["kind"] == "impact-modes"
        assert data.impulse.attrs["long_name"]
        assert data.impulse.attrs["units"]
        assert {"Omega", "omega", "constraint", "dof", "tau"} <= set(data.coords)
        np.testing.assert_array_equal(data.impulse.values, result.impulse)
        picked = data.impulse.sel(Omega=1.1, method="nearest", constraint=0)
        assert picked.size == 1
    assert result.to_xarray().sizes["dof"] == 13


def test_jobs_run_and_are_found_again(client: vi.Client) -> None:
    request = vi.impact_modes_request(STRUCTURE, (0.6, 2.4, 4001))
    job = client.submit("impact-modes", request)
    done = job.wait(60, progress=True)
    assert done.state == "succeeded"
    [*_, last] = job.refresh().history
    assert last["why"] == "succeeded"
    stored = client.job(job.id).result()
    np.testing.assert_array_equal(stored.impulse, client.compute("impact-modes", request).impulse)
    assert stored.digest in {client.result(stored.digest).digest}
    assert job.id in [each.id for each in client.jobs(state="succeeded", kind="impact-modes")]
    assert client.submit("impact-modes", request).wait(60).document["reused"]


def test_a_cancelled_job_says_so(client: vi.Client) -> None:
    request = vi.impact_modes_request(vi.chain(400, [vi.constraint(5, 0.2)]), (0.01, 2.4, 200_000))
    [job] = client.submit_many("impact-modes", [request], deadline=600.0).jobs
    assert job.document["deadline"] is not None
    job.cancel()
    with pytest.raises(vi.JobCancelled):
        job.wait(60)


def test_a_wrong_field_is_named(client: vi.Client) -> None:
    with pytest.raises(vi.InvalidRequest, match="/system/constraints/0/dof") as caught:
        client.impact_modes(vi.chain(3, [vi.constraint(3, 0.2)]), [1.0])
    assert caught.value.errors[0]["pointer"] == "/system/constraints/0/dof"


def test_a_plan_skips_what_is_not_asked(client: vi.Client) -> None:
    plan = client.plan("impact-modes", vi.impact_modes_request(STRUCTURE, [1.1]))
    assert {"shape", "waveform", "energy"} <= {skip["what"] for skip in plan["skips"]}


def test_pictures(client: vi.Client) -> None:
    curve = client.impact_modes(STRUCTURE, (0.6, 2.4, 50)).plot()
    assert curve.get_xlabel()
    profile = client.impact_modes(STRUCTURE, [1.1], outputs=("impulse", "shape")).plot()
    assert profile.get_ylabel()


def test_a_service_that_cannot_start_says_why(tmp_path: Path) -> None:
    (tmp_path / "store").write_text("in the way")
    with vi.Client(data=tmp_path / "fine") as other:
        assert other.version()["kinds"]
        with pytest.raises(vi.EmbeddedServiceError):
            vi.Client(data=tmp_path / "fine")


def test_a_history_is_arrays_tables_and_pictures(client: vi.Client) -> None:
    ball = vi.bouncing_ball([vi.constraint(0, {"lower": 0.0}, restitution=0.9)])
    result = client.time_history(ball, ([1.0], [0.0]), 10.0, t=101)
    assert result.kind == "time-history"
    assert result.x.shape == result.v.shape == (101, 1)
    assert result.energy.shape == (101,)
    assert result.impacts.time.size == result.count.impacts > 100
    np.testing.assert_allclose(result.impacts["time"][0], np.sqrt(2.0 / 9.81), rtol=1e-15)
    np.testing.assert_allclose(result.contacts.rest, 19.0 * np.sqrt(2.0 / 9.81), rtol=1e-14)
    assert result.error.predictable_until == 10.0
    assert "estimate" in result.error.statement
    ax = result.plot()
    assert ax.get_xlabel() == "time"
    plane = plots.phase_plane(result)
    assert "velocity" in plane.get_ylabel()
    with pytest.raises(AttributeError, match="it has"):
        _ = result.impacts.nothing
    assert {"time", "constraint", "side"} <= set(result.impacts)
    assert result.to_xarray().sizes == {"t": 101, "dof": 1}


def test_a_history_starts_on_an_impact_mode(client: vi.Client) -> None:
    load = [vi.harmonic(0, 1e-9, 0.5)]
    result = client.time_history(STRUCTURE, 3.0, 10.0, dofs=[5], t=[0.0, 10.0], load=load)
    half = np.pi / 3.0
    expected = half * np.arange(0.5, 10.0 / half)
    np.testing.assert_allclose(result.impacts.time, expected, rtol=1e-7)
    assert result.impacts.side.tolist() == [(-1) ** n for n in range(expected.size)]


def test_faults_of_a_history_are_named(client: vi.Client) -> None:
    for initial, t_end, pointer in (
        (([0.0] * 5 + [0.3] + [0.0] * 7, [0.0] * 13), 1.0, "/initial/x"),
        (([0.0], [0.0]), 1.0, "/initial/x"),
        (([0.0] * 13, [0.0] * 13), 0.0, "/t_end"),
        (0.5, 1.0, "/initial/impact_mode/Omega"),
    ):
        with pytest.raises(vi.InvalidRequest) as caught:
            client.time_history(STRUCTURE, initial, t_end)
        assert pointer in str(caught.value)
    with pytest.raises(vi.InvalidRequest, match="/tolerance"):
        client.time_history(STRUCTURE, ([0.0] * 13, [0.0] * 13), 1.0, tolerance=1e-18)


def test_bands_and_resonances_are_tables_and_pictures(client: vi.Client) -> None:
    structure = vi.chain(13, [vi.constraint(5, 0.2)])
    result = client.existence_bands(structure, 1.5, 3.0, outputs=("bands", "rejected", "stability"))
    assert result.bands.stop[-1] == 3.0
    # eq. 10.63
    assert result.bands.start[-1] == pytest.approx(2 * np.sin(13 * np.pi / 28), rel=1e-14)
    assert set(result.bands.certified) == {"yes"}
    assert result.bands.stop_reason[-1] == "range"
    assert result.plot().get_xlabel()
    resonances = client.resonances(structure, odd_max=3)
    assert resonances.Omega.size == 24
    assert resonances.plot().get_ylabel() == "resonating harmonic"


def test_ensembles_are_arrays_and_a_picture(client: vi.Client) -> None:
    structure = vi.oscillator([vi.constraint(0, 1.0, restitution=0.9)])
    x, v = (grid.ravel()[:, np.newaxis] for grid in np.mgrid[-0.9:0.9:5j, -4.0:4.0:6j])
    result = client.ensemble(structure, x, v, 10.0, t=[10.0])
    assert result.x.shape == (30, 1, 1)
    assert set(result.status) == {"ok"}
    each = result.each("impacts")
    assert [rows.time.size for rows in each] == result.impact_count.tolist()
    assert all(np.shares_memory(rows.time, result.impacts.time) for rows in each if rows.time.size)
    np.testing.assert_array_equal(each[7].time, result.rows("impacts", member=7).time)
    alone = client.time_history(structure, (x[7], v[7]), 10.0)
    np.testing.assert_array_equal(each[7].time, alone.impacts.time)
    axes = result.plot()
    assert axes.get_xlabel() == "$x_{0}(0)$"
    assert axes.get_ylabel() == "$v_{0}(0)$"
    colours = axes.collections[0].get_array()
    np.testing.assert_array_equal(colours.T.ravel(), result.impact_count)
    line = client.ensemble(structure, x[:3] * 0.0, [[1.0], [2.0], [3.0]], 10.0)
    assert plots.basins(line).get_ylabel() == "number of impacts"
    with pytest.raises(ValueError, match="differ in 0"):
        plots.basins(client.ensemble(structure, [[0.0]], [[1.0]], 1.0))


def test_tables_are_seen_and_open_in_xarray(client: vi.Client) -> None:
    bands = client.existence_bands(STRUCTURE, 0.6, 2.4)
    count = bands.bands.start.size
    assert f"bands ({count} rows)" in repr(bands)
    assert f"{count} rows" in bands._repr_html_()
    assert bands.bands.rows == count
    assert bands.bands._repr_html_().count("<tr>") == count + 1
    data = bands.to_xarray("bands")
    np.testing.assert_array_equal(data.start.values, bands.bands.start)
    assert data.start.attrs["long_name"] == "lower edge of a band, Omega"
    with pytest.raises(ValueError, match=r"no table 'band'.*bands, .*rejected"):
        bands.to_xarray("band")


def test_frequency_over_energy_is_drawn(client: vi.Client) -> None:
    """Admissible solutions are drawn, each in the line of its stability."""
    outputs = ["exists", "energy", "stability"]
    result = client.impact_modes(
        vi.two_mass(vi.constraint(0, 1.0)), (0.3, 4.0, 400), outputs=outputs
    )
    lines = result.plot(output="energy").get_lines()
    assert [line.get_label() for line in lines] == ["neutral", "unstable"]
    neutral = result.neutral == "yes"
    for line, some in zip(lines, (neutral, ~neutral), strict=True):
        energy, Omega = line.get_data()
        np.testing.assert_array_equal(np.isfinite(energy), result.exists & some)
        np.testing.assert_array_equal(Omega, result.Omega)
    with pytest.raises(ValueError, match="harmonics can be drawn, not 'modes'"):
        result.plot(output="modes")


def test_phantoms_are_known_by_their_reason(client: vi.Client) -> None:
    """Positive impulses alone do not make a motion: the structure may pass through its stop."""
    structure = vi.chain(13, [vi.constraint(5, 0.2)])
    outputs = ["impulse", "reason", "energy", "stability"]
    result = client.impact_modes(structure, (0.6, 2.6, 300), outputs=outputs)
    admissible = result.reason == "ok"
    assert ((result.impulse > 0.0).all(axis=1) & ~admissible).any()
    lines = result.plot(output="energy").get_lines()
    assert [line.get_label() for line in lines] == ["neutral", "unstable"]
    drawn = np.any([np.isfinite(line.get_xdata()) for line in lines], axis=0)
    np.testing.assert_array_equal(drawn, admissible)
    strong = next(line for line in result.plot().get_lines() if line.get_label() == "admissible")
    np.testing.assert_array_equal(np.isfinite(strong.get_ydata()), admissible)


def test_axes_carry_units(client: vi.Client) -> None:
    units = {"length": "m", "mass": "kg", "time": "s"}
    structure = vi.system([2.0], [50.0], vi.constraint(0, 0.1), units=units)
    result = client.impact_modes(structure, (5.5, 9.0, 20), outputs=["impulse", "exists", "energy"])
    assert result.unit("impulse") == "N"
    assert result.plot().get_ylabel().endswith("(kg m/s)")
    assert result.plot(output="energy").get_xlabel() == "energy (J)"


def test_a_history_of_impacts_alone_is_drawn(client: vi.Client) -> None:
    result = client.time_history(STRUCTURE, 1.3, 50.0)
    line = result.plot().get_lines()[0]
    np.testing.assert_array_equal(line.get_ydata(), result.impacts.impulse)
    np.testing.assert_array_equal(line.get_xdata(), result.impacts.time)


def test_a_structure_is_sent_once(client: vi.Client) -> None:
    M, K = np.eye(3), np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    kept = client.store(vi.system(M, K, []))
    stop = [vi.constraint(2, 0.3)]
    modes = client.impact_modes(kept | {"constraints": stop}, (1.9, 3.0, 10))
    direct = client.impact_modes(vi.system(M, K, stop), (1.9, 3.0, 10))
    np.testing.assert_array_equal(modes.impulse, direct.impulse)


def test_a_batch_answers_one_by_one(client: vi.Client) -> None:
    structures = [vi.chain(3, [vi.constraint(0, gap)]) for gap in (0.1, -0.1, 0.2)]
    requests = [vi.impact_modes_request(one, [2.0, 2.1]) for one in structures]
    first, wrong, last = client.batch("impact-modes", requests)
    assert isinstance(first, dict)
    assert isinstance(last, dict)
    assert isinstance(wrong, vi.InvalidRequest)
    assert wrong.errors[0]["pointer"] == "/system/constraints/0/gap"
    # Gap and impulse are proportional.
    np.testing.assert_allclose(2.0 * np.array(first["impulse"]), last["impulse"], rtol=1e-14)


def test_what_has_no_effect_is_warned_of(client: vi.Client) -> None:
    lossy = vi.chain(3, [vi.constraint(0, 0.1, restitution=0.7)])
    request = vi.impact_modes_request(lossy, [2.0, 2.1])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = client.impact_modes(lossy, [2.0, 2.1])
        client.submit("impact-modes", request).wait().result()
        client.result(result.digest)
        client.batch("impact-modes", [request, request])
    assert [Path(each.filename) for each in caught] == [Path(__file__)] * 4
    assert {each.category for each in caught} == {vi.NeglectedWarning}
    assert len(result.neglected) == 1


def test_reprs_say_where_and_how_far(client: vi.Client) -> None:
    assert repr(client) == f"<Client {client.url}>"
    job = client.submit("impact-modes", vi.impact_modes_request(STRUCTURE, (0.6, 2.4, 77)))
    assert job.wait()._repr_html_().count(job.id) == 1
    assert "succeeded" in job._repr_html_()


def test_a_sweep_shows_its_outputs_and_not_what_is_about_them(client: vi.Client) -> None:
    base = vi.time_history_request(STRUCTURE, 1.3, 20.0, outputs=["impacts"])
    gaps = {"system.constraints.0.gap": [0.1, 0.2]}
    swept = client.sweep("time-history", base, gaps)
    assert f"impacts ({swept.impacts.time.size} rows)" in repr(swept)
    assert "axes" not in repr(swept)
    assert "error" not in repr(swept)
    assert "<td" in swept.axes._repr_html_()
