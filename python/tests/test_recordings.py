"""Recordings and tables as arrays."""

import bench
import deacal
import numpy as np
import pytest


@pytest.fixture(scope="module")
def robot():
    return deacal.read(bench.TWIN / "symmetric")


def test_a_robot_is_read_as_it_was_written(robot):
    assert robot.kind == "robot"
    assert robot.id == "twin2026/symmetric" or robot.id.endswith("symmetric")
    assert robot.path == bench.TWIN / "symmetric" / "recording.toml"
    n, m = len(robot.time_s), len(robot.voltage_time_s)
    shapes = {"time_s": (n,), "positions": (n, 3), "voltage_time_s": (m,), "voltages": (m, 3)}
    for name, shape in shapes.items():
        assert robot[name].shape == shape and robot[name].dtype == np.float64
    assert robot.units["positions"] == "mm" and robot.units["voltages"] in ("V", "kV")
    assert robot.clocks["positions"] == "time_s" and robot.clocks["voltages"] == "voltage_time_s"
    assert robot.rig and robot.keys()[0] == "time_s" and "positions" in robot
    lines = (bench.TWIN / "symmetric" / "voltage.csv").read_text().splitlines()
    written = [float(v) for v in lines[-1].split(",")][:4]
    assert [robot.voltage_time_s[-1], *robot.voltages[-1]] == written


def test_missing_samples_are_gaps_and_nan(truth, tmp_path):
    made = deacal.simulate(bench.RIG, truth, drive=bench.SINE, duration=2.0, gaps=[(0.5, 0.2)])
    made.save(tmp_path / "gap")
    recording = deacal.read(tmp_path / "gap")
    assert recording.gaps == [(pytest.approx(0.5), 20)]
    assert np.isnan(recording.positions).any(axis=1).sum() == 20


def test_tables_of_every_kind_are_read():
    coupon = deacal.read(bench.COUPON)
    assert coupon.kind == "film-coupon" and coupon.positions is None
    assert coupon.units["stress"] == "kPa" and coupon["stretch"].shape == coupon.time_s.shape
    hinge = deacal.read(bench.HINGE)
    assert hinge.kind == "hinge-bench" and len(hinge["angle"]) == len(hinge["torque"])
    axis = deacal.read(bench.AXIS)
    assert axis.kind == "axis" and axis["position"].shape == axis.time_s.shape
    assert axis["input"].dtype == np.float64


def test_arrays_are_made_once_and_cannot_be_written_to(robot):
    assert robot.positions is robot["positions"]
    with pytest.raises(ValueError, match="read-only"):
        robot.positions[0, 0] = 1.0
    with pytest.raises(KeyError, match="there are: time_s, positions"):
        robot["position"]


def test_findings_are_the_checks(robot, tmp_path):
    assert robot.check() == []
    folder = tmp_path / "cm"
    folder.mkdir()
    text = (bench.TWIN / "symmetric" / "recording.toml").read_text()
    text = text.replace("../rig.toml", str(bench.RIG))
    (folder / "recording.toml").write_text(text)
    (folder / "voltage.csv").write_bytes((bench.TWIN / "symmetric" / "voltage.csv").read_bytes())
    lines = (bench.TWIN / "symmetric" / "motion.csv").read_text().splitlines()
    begin = next(i for i, line in enumerate(lines) if line.startswith("1,"))

    def tenth(line):
        cells = line.split(",")
        return ",".join(cells[:2] + [c and str(float(c) / 10) for c in cells[2:]])

    lines[begin:] = [tenth(line) if line else line for line in lines[begin:]]
    (folder / "motion.csv").write_text("\n".join(lines) + "\n")
    found = deacal.read(folder).check()
    assert found and {"check", "says", "remedy"} <= set(found[0])


def test_an_aligned_recording_is_what_import_leaves(robot, program, tmp_path):
    aligned = robot.aligned()
    bench.ask(program, ["import", bench.TWIN / "symmetric", "--also", "npz"], tmp_path / "out")
    file = next((tmp_path / "out").rglob("*.npz"))
    theirs = np.load(file)
    assert sorted(aligned.keys()) == sorted(theirs.keys())
    for name in aligned.keys():
        np.testing.assert_array_equal(aligned[name], theirs[name])


def test_pandas_has_a_frame_a_clock(robot):
    pytest.importorskip("pandas")
    frame = robot.to_pandas()
    assert frame.index.name == "time_s" and "positions_z" in frame
    assert frame["positions_z"].iloc[3] == robot.positions[3, 2]
    assert list(robot.to_pandas("voltage_time_s")) == ["voltages_1", "voltages_2", "voltages_3"]
    assert "stress" in deacal.read(bench.COUPON).to_pandas()
    with pytest.raises(KeyError, match="no clock"):
        robot.to_pandas("clock")


def test_xarray_has_clocks_as_dimensions_and_units(robot):
    pytest.importorskip("xarray")
    data = robot.to_xarray()
    assert data["positions"].dims == ("time_s", "axis") and data["positions"].attrs["units"] == "mm"
    assert data["voltages"].dims == ("voltage_time_s", "channel")
    assert float(data["positions"].sel(axis="z")[5]) == robot.positions[5, 2]
    assert data.attrs["id"] == robot.id


def test_a_prediction_is_a_table_with_flags(truth, tmp_path):
    pytest.importorskip("pandas")
    made = deacal.simulate(bench.RIG, truth, drive=bench.SINE, duration=2.0, gaps=[(0.5, 0.2)])
    made.save(tmp_path / "gap")
    found = deacal.predict(tmp_path / "gap", truth)
    assert isinstance(found, deacal.Table) and len(found) == 201 == len(found.flags)
    assert found.keys()[:4] == ["time_s", "phi1_V", "phi2_V", "phi3_V"]
    assert set(found.flags) >= {"", "gap"}
    frame = found.to_pandas()
    assert frame.index.name == "time_s" and (frame["flag"] == "gap").sum() == 20
    assert frame["phi1_V"].isna().sum() >= 20
    told = frame["phi1_V"][frame["flag"] == ""].to_numpy()
    # the motion that 4 kV make needs 4 kV
    assert told.max() == pytest.approx(4000.0, rel=0.01)
    pytest.importorskip("xarray")
    assert found.to_xarray()["flag"].dims == ("time_s",)


def test_a_motion_that_is_predicted_is_the_one_that_was_simulated(truth, tmp_path):
    made = deacal.simulate(bench.RIG, truth, drive=bench.SINE, duration=2.0)
    made.save(tmp_path / "made")
    again = deacal.predict(deacal.read(tmp_path / "made"), truth, "motion")
    np.testing.assert_allclose(again["z_mm"], made["z_mm"], atol=1e-3)
    assert np.ptp(made["z_mm"]) > 0.1
