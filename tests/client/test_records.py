"""Records of a base: as files have them, and as motions that pass through their samples."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import vibroimpact as vi

RNG = np.random.default_rng(7)
TIMES = np.concatenate([[0.0], np.cumsum(RNG.uniform(0.05, 0.15, 40))])
SAMPLES = RNG.normal(size=TIMES.size)


def _integrated(t: np.ndarray, slope: np.ndarray, start: float) -> np.ndarray:
    """Return the integral of straight lines at their ends."""
    steps = 0.5 * np.diff(t) * (slope[1:] + slope[:-1])
    return start + np.concatenate([[0.0], np.cumsum(steps)])


def test_the_base_passes_through_samples_of_its_displacement() -> None:
    """Twice integrated by the closed form of a straight line, from the first step's velocity."""
    t, a = vi.Record(TIMES, SAMPLES, "displacement").acceleration()
    h = np.diff(t)
    moved = h**2 * (2.0 * a[:-1] + a[1:]) / 6.0
    start = (SAMPLES[1] - SAMPLES[0] - moved[0]) / h[0]
    v = _integrated(t, a, start)
    found = SAMPLES[0] + np.concatenate([[0.0], np.cumsum(v[:-1] * h + moved)])
    np.testing.assert_allclose(found, SAMPLES, atol=1e-10)


def test_the_base_passes_through_samples_of_its_velocity() -> None:
    knots, a = vi.Record(TIMES, SAMPLES, "velocity").acceleration()
    at_knots = _integrated(knots, a, SAMPLES[0])
    for t, v in zip(TIMES, SAMPLES, strict=True):
        k = min(int(np.searchsorted(knots, t, side="right")) - 1, knots.size - 2)
        step = t - knots[k]
        slope = (a[k + 1] - a[k]) / (knots[k + 1] - knots[k])
        assert at_knots[k] + a[k] * step + 0.5 * slope * step**2 == pytest.approx(v, abs=1e-11)


@pytest.mark.needs("processes")
@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("quantity", ["acceleration", "velocity", "displacement"])
def test_samples_of_a_vibration_do_what_the_vibration_does(quantity: str) -> None:
    """The base moves by u sin(3 t); relative to it, the structure starts with -3 u."""
    n, omega, amplitude = 2, 3.0, 0.05
    K = np.array([[20.0, -8.0], [-8.0, 8.0]])
    structure = vi.system(np.eye(n), K, [], damping=0.02, influence=np.ones(n))
    start = np.zeros(n), np.zeros(n)
    size = amplitude * omega ** ("displacement", "velocity", "acceleration").index(quantity)
    phase = {"displacement": -0.5, "velocity": 0.0, "acceleration": 0.5}[quantity] * np.pi
    t = np.linspace(0.0, 10.0, 1001)
    record = vi.Record(t, size * np.cos(omega * t + phase), quantity)
    smooth = vi.base_vibration("displacement", amplitude, frequency=omega, phase=-0.5 * np.pi)
    local = vi.Local()
    sampled, exact = (
        local.time_history(structure, start, 10.0, t=50, load=[load], outputs=["x"])
        for load in (record.base_motion(), smooth)
    )
    assert np.abs(exact.x).max() > amplitude
    # Straight lines between samples of a cosine have the share 1 - (omega h)^2/12 of it.
    largest = np.abs(exact.x).max()
    assert np.abs(sampled.x - exact.x).max() < 1.02 * (omega * 0.01) ** 2 / 12 * largest


@pytest.mark.needs("processes")
@pytest.mark.needs("compiled kernels")
def test_records_that_end_before_the_motion_go_on_at_rest() -> None:
    record = vi.Record([0.0, 0.5, 1.0], [0.0, 2.0, 1.0])
    assert record.base_motion()["t"] == [0.0, 0.5, 1.0]
    assert record.base_motion(until=1.0)["t"] == [0.0, 0.5, 1.0]
    for until, t in ((1.2, [0.0, 0.5, 1.0, 1.5]), (9.0, [0.0, 0.5, 1.0, 1.5, 9.0])):
        load = record.base_motion(until=until)
        assert load["t"] == t
        assert load["acceleration"] == [0.0, 2.0, 1.0] + [0.0] * (len(t) - 3)
    structure = vi.system(1.0, 4.0, [], influence=[1.0])
    local = vi.Local()
    with pytest.raises(vi.InvalidRequest, match="end"):
        local.time_history(structure, ([0.0], [0.0]), 9.0, t=9, load=[record.base_motion()])
    longer = record.base_motion(until=9.0)
    motion = local.time_history(structure, ([0.0], [0.0]), 9.0, t=91, load=[longer])
    # Without acceleration, the oscillator keeps its energy.
    late = motion.t >= 1.5
    energy = 0.5 * motion.v[late, 0] ** 2 + 2.0 * motion.x[late, 0] ** 2
    np.testing.assert_allclose(energy, energy[0], rtol=1e-10)


def _peer(values: np.ndarray, head: str, kind: str = "ACCELERATION") -> str:
    """Return a record as PEER writes it: four lines, then five values in each."""
    rows = [values[k : k + 5] for k in range(0, values.size, 5)]
    text = "".join("".join(f"{value:15.7E}" for value in row) + "\n" for row in rows)
    title = "PEER NGA STRONG MOTION DATABASE RECORD\nMADE FOR A TEST, 1/1/00, STATION, 180\n"
    return f"{title}{kind} TIME SERIES IN UNITS OF G\n{head}\n{text}"


@pytest.mark.parametrize(
    "head",
    ["NPTS=  {count}, DT=   .0050 SEC,", "  {count}    0.0050    NPTS, DT",
     "NPTS = {count} , DT = .00500 SEC"],
)  # fmt: skip
@pytest.mark.parametrize(
    ("ending", "quantity"),
    [("AT2", "acceleration"), ("at2", "acceleration"), ("VT2", "velocity"),
     ("DT2", "displacement")],
)  # fmt: skip
def test_records_of_peer(tmp_path: Path, head: str, ending: str, quantity: str) -> None:
    path = tmp_path / f"RSN6.{ending}"
    path.write_text(_peer(SAMPLES, head.format(count=SAMPLES.size), quantity.upper()))
    record = vi.read_record(path, scale=9.80665)
    assert record.quantity == quantity
    np.testing.assert_allclose(record.t, 0.005 * np.arange(SAMPLES.size), rtol=1e-15)
    np.testing.assert_allclose(record.values, 9.80665 * SAMPLES, rtol=1e-7)


@pytest.mark.parametrize("titles", ["", "time;value\n"])
def test_records_in_tables(tmp_path: Path, titles: str) -> None:
    path = tmp_path / "ground.csv"
    rows = [f"{t!r};{v!r}\n" for t, v in zip(TIMES.tolist(), SAMPLES.tolist(), strict=True)]
    path.write_bytes(b"\xef\xbb\xbf" + (titles + "".join(rows)).encode())
    record = vi.read_record(path, "velocity", scale=0.01)
    assert (record.quantity, record.t.tolist()) == ("velocity", TIMES.tolist())
    np.testing.assert_allclose(record.values, 0.01 * SAMPLES, rtol=1e-15)
    path.write_text("".join(f"{v!r}\n" for v in SAMPLES.tolist()))
    record = vi.read_record(path, interval=0.02)
    np.testing.assert_allclose(record.t, 0.02 * np.arange(SAMPLES.size), rtol=1e-15)
    np.testing.assert_array_equal(record.values, SAMPLES)


@pytest.mark.parametrize(
    ("name", "text", "reason"),
    [("a.at2", "1.0 2.0\n", "line 1: no line with NPTS and DT among the first 10"),
     ("a.at2", _peer(SAMPLES, "NPTS= 99, DT= .01 SEC"), "line 4: 99 values are announced, 41 foll"),
     ("a.at2", _peer(SAMPLES, "NPTS= 41, DT= .01 SEC") + "end", "line 14: 'end' is no row of num"),
     ("a.at2", _peer(SAMPLES, "NPTS= 41, DT= .00 SEC"), "t: times do not ascend"),
     ("a.csv", "1\n2\n", "1 numbers in a row: two are time and value"),
     ("a.csv", "1,2,3\n2,3,4\n", "3 numbers in a row: two are time and value"),
     ("a.csv", "0,1\n0,2\n", "t: times do not ascend"),
     ("a.csv", "0,1\nx,2\n", "line 2: 'x' is not a number"),
     ("a.csv", "0,1\n", "values: 1 samples of the acceleration; at least 2")],
)  # fmt: skip
def test_what_is_no_record_is_refused(tmp_path: Path, name: str, text: str, reason: str) -> None:
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(ValueError, match=f"{re.escape(str(path))}: {reason}"):
        vi.read_record(path)


def test_wrong_records_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"quantity: acceleration, .* not 'jerk'"):
        vi.Record([0, 1], [0, 1], "jerk")
    with pytest.raises(ValueError, match=r"t \(2,\) and values \(3,\) are not as many numbers"):
        vi.Record([0, 1], [0, 1, 2])
    with pytest.raises(ValueError, match="values: 3 samples of the displacement; at least 4"):
        vi.Record([0, 1, 2], [0, 1, 2], "displacement")
    with pytest.raises(ValueError, match="not all numbers are finite"):
        vi.Record([0, 1], [0, np.inf])
    path = tmp_path / "a.at2"
    path.write_text(_peer(SAMPLES, "NPTS= 41, DT= .01 SEC"))
    with pytest.raises(ValueError, match="says itself that it has the acceleration"):
        vi.read_record(path, "velocity")
