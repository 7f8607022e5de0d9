"""What cannot be done is said in the program's words."""

import re
import subprocess

import bench
import deacal
import pytest


def test_classes():
    assert issubclass(deacal.DeacalError, Exception)
    assert deacal.DeacalError.__module__ == "deacal"


def test_words_are_the_programs(program, tmp_path):
    missing = tmp_path / "nothing"
    for arguments, call in [
        (["fit", "film", missing], lambda: deacal.fit_film(missing)),
        (["fit", "coupon", bench.TWIN / "symmetric"], lambda: deacal.fit_coupon(bench.TWIN / "symmetric")),
        (
            ["fit", "coupon", bench.COUPON, "--fix", "mu_9=1"],
            lambda: deacal.fit_coupon(bench.COUPON, fix={"mu_9": 1}),
        ),
    ]:
        words = [program, *map(str, arguments), "-o", str(tmp_path / "out")]
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        assert done.returncode == 1
        with pytest.raises((deacal.DeacalError, ValueError)) as raised:
            call()
        assert done.stderr.strip().splitlines()[-1] == f"deacal: {raised.value}"


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(deacal.DeacalError, match=re.escape(str(tmp_path / "nothing"))):
        deacal.read(tmp_path / "nothing")


def test_kinds_do_not_mix():
    with pytest.raises(deacal.DeacalError, match='is of kind "robot", this command works on "film-coupon"'):
        deacal.fit_coupon(deacal.read(bench.TWIN / "symmetric"))
    with pytest.raises(deacal.DeacalError, match="is named twice"):
        deacal.fit_film([bench.TWIN / "symmetric"] * 2)
    with pytest.raises(deacal.DeacalError, match="no recording was given"):
        deacal.fit_film([])


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: deacal.fit_coupon(bench.COUPON, fix={"mu_9": 1.0}), "there is no parameter `mu_9`"),
        (lambda: deacal.fit_coupon(bench.COUPON, branches=9), "branches: 9 is not in 0..=8"),
        (lambda: deacal.fit_film(bench.TWIN / "symmetric", starts=0), "starts: 0 is not in 1..=1000"),
        (lambda: deacal.fit_axis(bench.AXIS, objective="both"), "there are: input, motion"),
        (lambda: deacal.fit_axis(bench.AXIS, cause=["choose"]), "--objective motion"),
        (lambda: deacal.diagnose(bench.COUPON, only=["frictoin"]), "no cause is called `frictoin`"),
        (lambda: deacal.diagnose(bench.COUPON, false_alarms=0.9), "false_alarms: 0.9 is not in"),
        (lambda: deacal.predict(bench.COUPON, "p.toml", "speed"), "there are: voltage, force, motion"),
        (lambda: deacal.ageing(bench.COUPON, by="week"), "there are: day, batch"),
        (lambda: deacal.ageing(bench.COUPON, threshold=120), "--threshold 120"),
        (lambda: deacal.validate(bench.COUPON, "p.toml", compare="book"), "there are: paper"),
        (lambda: deacal.fit_film(bench.TWIN / "symmetric", progress=3), "progress: expected a function"),
    ],
)
def test_wrong_arguments_are_value_errors(call, words):
    with pytest.raises(ValueError, match=re.escape(words)):
        call()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"drive": "sinus:peak_V=1"}, "drive: no drive `sinus`, nearest is `sine`"),
        ({"drive": bench.SINE, "noise": -1.0}, "noise: -1 is not 0 or above"),
        ({"drive": bench.SINE, "duration": 0.0}, "duration: 0 is not above 0"),
        ({"drive": bench.SINE, "effects": ["frictoin:torque=1"]}, "effects: "),
        ({"drive": bench.SINE, "id": "../up"}, "id: expected a name"),
        ({"voltage": ([0.0, 1.0], [[1.0, 2.0]] * 2)}, "shape (m,) or (m, 3), got [2, 2]"),
        ({"voltage": ([1.0, 0.0], [1.0, 2.0])}, "times must rise"),
    ],
)
def test_wrong_simulations_are_value_errors(options, words, truth):
    with pytest.raises(ValueError, match=re.escape(words)):
        deacal.simulate(bench.RIG, truth, **options)


def test_wrong_types_are_type_errors(truth):
    with pytest.raises(TypeError, match=r"a path or a deacal\.Recording, got int"):
        deacal.fit_film(3)
    with pytest.raises(TypeError, match=r"a path or a deacal\.Recording, got int"):
        deacal.fit_film([bench.TWIN / "symmetric", 3])
    with pytest.raises(TypeError, match="ParameterFile"):
        deacal.predict(bench.COUPON, 3)
    with pytest.raises(TypeError, match="ParameterFile"):
        deacal.validate(bench.COUPON, 3)
    with pytest.raises(TypeError, match="ParameterFile"):
        deacal.validate(bench.COUPON, ["p.toml", 3])
    with pytest.raises(deacal.DeacalError, match="no parameters were given"):
        deacal.validate(bench.COUPON, [])
    with pytest.raises(TypeError, match="one of drive, voltage and path"):
        deacal.simulate(bench.RIG, truth)


def test_a_voltage_beyond_the_limit_is_refused(truth):
    with pytest.raises(deacal.DeacalError, match="above the limit of 3000.000 V"):
        deacal.simulate(bench.RIG, truth, drive=bench.SINE, limit=3000.0)


def test_parameters_that_cannot_be_are_refused(tmp_path):
    bad = tmp_path / "bad.toml"
    bad.write_text(bench.TRUTH.replace("1120e3", '"many"'))
    with pytest.raises(deacal.DeacalError, match="bad.toml"):
        deacal.ParameterFile.read(bad)
