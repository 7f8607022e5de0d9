"""Numbers and files are the program's: to the bit where there is one, else its numbers of the day."""

import json
from pathlib import Path

import bench
import deacal
import numpy as np
import pytest

GOLDEN = json.loads(Path(__file__).with_name("golden.json").read_text())


def same_files(ours, theirs):
    """Files of two folders, apart from the lines that say how they were asked for."""
    names = sorted(p.relative_to(theirs) for p in theirs.rglob("*") if p.is_file())
    names = [n for n in names if not n.name.startswith(".")]
    assert names
    for name in names:
        if name.suffix == ".html":
            assert abs(len((ours / name).read_text()) - len((theirs / name).read_text())) < 2000
            continue
        both = [(f / name).read_text().splitlines() for f in (ours, theirs)]
        kept = [[line for line in lines if "command" not in line] for lines in both]
        assert kept[0] == kept[1], name


@pytest.mark.parametrize("name", bench.ON_DATA)
def test_fits_have_the_golden_numbers(name):
    # another processor may round the last digits of a search differently
    fit = bench.fitted(name)
    assert list(fit.parameters) == list(GOLDEN[name])
    for parameter, (value, std_error) in GOLDEN[name].items():
        of = fit.parameters[parameter]
        assert of.value == pytest.approx(value, rel=1e-6, abs=1e-12)
        if std_error is None:
            assert of.std_error is None
        else:
            assert of.std_error == pytest.approx(std_error, rel=1e-4)


@pytest.mark.parametrize("name", bench.ON_DATA)
def test_fits_are_the_programs(name, program, tmp_path):
    said = bench.ask(program, bench.ON_DATA[name][0], tmp_path / "theirs")
    fit = bench.fitted(name)
    assert bench.without_command(fit.json) == bench.without_command(said)
    fit.save(tmp_path / "ours")
    same_files(tmp_path / "ours", tmp_path / "theirs")


def test_a_fit_goes_on_from_another(program, tmp_path):
    film = bench.fitted("film")
    film.save(tmp_path / "film")
    arguments = ["fit", "forearm", bench.TWIN / "single-1", "--starts", "1"]
    arguments += ["--params", tmp_path / "film" / "parameters.toml", "--fix", "torque_0deg=0"]
    said = bench.ask(program, arguments, tmp_path / "theirs")
    ours = deacal.fit_forearm(
        bench.TWIN / "single-1", starts=1, start=film, fix={"torque_0deg": 0}
    )
    assert bench.without_command(ours.json) == bench.without_command(said)


def test_samples_and_their_ageing_are_the_programs(program, samples, tmp_path):
    arguments = ["fit", "sample", *samples, "--branches", "1", "--starts", "1"]
    said = bench.ask(program, arguments, tmp_path / "fit")
    ours = deacal.fit_sample(samples, branches=1, starts=1)
    assert bench.without_command(ours.json) == bench.without_command(said)
    said = bench.ask(program, ["ageing", *samples, "--cycles", "4"], tmp_path / "theirs")
    ours = deacal.ageing(samples, cycles=4)
    assert bench.without_command(ours.json) == bench.without_command(said)
    ours.save(tmp_path / "ours")
    same_files(tmp_path / "ours", tmp_path / "theirs")


@pytest.mark.parametrize("recordings", [["symmetric", "single-1"], []])
def test_diagnoses_are_the_programs(recordings, program, tmp_path):
    paths = [bench.TWIN / name for name in recordings] or [bench.COUPON]
    said = bench.ask(program, ["diagnose", *paths], tmp_path / "theirs")
    ours = deacal.diagnose(paths)
    assert bench.without_command(ours.json) == bench.without_command(said)
    ours.save(tmp_path / "ours")
    same_files(tmp_path / "ours", tmp_path / "theirs")


@pytest.mark.parametrize(
    ("what", "recording", "fit", "ending"),
    [
        ("voltage", bench.TWIN / "circle-3s", "film", "csv"),
        ("voltage", bench.TWIN / "circle-3s", "film", "npz"),
        ("force", bench.TWIN / "circle-3s", "film", "csv"),
        ("motion", bench.TWIN / "circle-3s", "film", "csv"),
        ("force", bench.COUPON, "coupon", "csv"),
        ("force", bench.HINGE, "hinge", "csv"),
        ("voltage", bench.AXIS, "axis", "csv"),
        ("motion", bench.AXIS, "axis, its motion", "csv"),
    ],
)
def test_predictions_are_the_programs(what, recording, fit, ending, program, tmp_path):
    parameters = bench.fitted(fit).parameter_file
    parameters.save(tmp_path / "parameters.toml")
    arguments = ["predict", what, recording, "--params", tmp_path / "parameters.toml"]
    theirs, ours = tmp_path / f"theirs.{ending}", tmp_path / f"ours.{ending}"
    bench.ask(program, arguments, theirs)
    deacal.predict(recording, parameters, what).save(ours)
    assert ours.read_bytes() == theirs.read_bytes()


@pytest.mark.parametrize(
    ("recordings", "fits"),
    [
        ([bench.TWIN / "circle-3s"], ["film"]),
        ([bench.TWIN / "circle-3s", bench.TWIN / "single-2"], ["film", "robot"]),
        ([bench.COUPON], ["coupon"]),
        ([bench.HINGE], ["hinge"]),
        ([bench.AXIS], ["axis", "axis, its motion"]),
    ],
)
def test_validations_are_the_programs(recordings, fits, program, tmp_path):
    files = [tmp_path / f"{i}.toml" for i, _ in enumerate(fits)]
    arguments = ["validate", *recordings]
    for file, fit in zip(files, fits):
        bench.fitted(fit).parameter_file.save(file)
        arguments += ["--params", file]
    said = bench.ask(program, arguments, tmp_path / "theirs")
    ours = deacal.validate(recordings, files)
    assert bench.without_command(ours.json) == bench.without_command(said)
    ours.save(tmp_path / "ours")
    same_files(tmp_path / "ours", tmp_path / "theirs")


def test_validations_of_samples_are_the_programs(program, truth, samples, tmp_path):
    said = bench.ask(program, ["validate", *samples, "--params", truth], tmp_path / "theirs")
    ours = deacal.validate(samples, truth)
    assert bench.without_command(ours.json) == bench.without_command(said)


def test_predictions_of_samples_are_the_programs(program, truth, samples, tmp_path):
    for what in ["voltage", "motion"]:
        arguments = ["predict", what, samples[0], "--params", truth]
        bench.ask(program, arguments, tmp_path / f"{what}.csv")
        deacal.predict(samples[0], truth, what).save(tmp_path / f"ours-{what}.csv")
        theirs = (tmp_path / f"{what}.csv").read_bytes()
        assert (tmp_path / f"ours-{what}.csv").read_bytes() == theirs


def test_columns_hold_every_digit_of_what_the_csv_rounds(tmp_path):
    found = deacal.predict(bench.TWIN / "circle-3s", bench.fitted("film"), "voltage")
    found.save(tmp_path / "all.npz", full=True)
    whole = np.load(tmp_path / "all.npz")
    known = ~np.isnan(found["phi1_V"])
    assert known.sum() > 100
    np.testing.assert_array_equal(found["phi1_V"][known], whole["phi1_predicted_V"][known])


def test_simulations_are_the_programs(program, truth, tmp_path):
    said = bench.ask(
        program,
        ["simulate", "--rig", bench.RIG, "--params", truth, "--drive", bench.SINE, "--duration", "2"]
        + ["--effect", "joint_friction:torque=5e-4,presliding=6e-3", "--noise", "0.03", "--seed", "7"]
        + ["--gap", "0.5:0.2", "--payload", "0,1:2", "--clock-offset", "0.02", "--day", "3", "--id", "simulated"],
        tmp_path / "theirs",
    )
    ours = deacal.simulate(
        bench.RIG, truth, drive=bench.SINE, duration=2.0, noise=0.03, seed=7, gaps=[(0.5, 0.2)],
        effects=["joint_friction:torque=5e-4,presliding=6e-3"], payload="0,1:2", clock_offset=0.02, day=3,
    ).save(tmp_path / "ours")
    assert ours.pop("folder") != said.pop("folder")
    assert ours == said
    same_files(tmp_path / "ours", tmp_path / "theirs")


def test_a_path_and_given_voltages_drive_alike(truth, tmp_path):
    plan = tmp_path / "plan.csv"
    times = np.arange(0.0, 4.0, 0.01)
    rows = ["time_s,x_mm,y_mm,z_mm"]
    rows += [f"{t:.3f},{2 * np.sin(t) ** 2:.6f},0,-50" for t in times]
    plan.write_text("\n".join(rows) + "\n")
    planned = deacal.simulate(bench.RIG, truth, path=plan)
    again = deacal.simulate(bench.RIG, truth, voltage=(planned.voltage_time_s, planned.voltages))
    np.testing.assert_allclose(again["x_mm"], planned["x_mm"], atol=1e-6)
    assert np.ptp(planned["x_mm"]) > 1.0
