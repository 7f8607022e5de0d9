"""What results are made of."""

import bench
import deacal
import numpy as np
import pytest


@pytest.fixture(scope="module")
def fit():
    return bench.fitted("film")


def test_parameters_have_values_units_and_intervals(fit):
    for name, of in fit.parameters.items():
        said = fit.json["parameters"][name]
        assert of.name == name and float(of) == of.value == said["value"]
        assert (of.unit, of.fixed, of.identifiable) == (said["unit"], said["fixed"], said["identifiable"])
        if of.std_error is not None and of.identifiable:
            low, high = of.ci95
            assert low < of.value < high
    assert fit.job == "film" and fit.converged and fit.rmse_unit == "V" and fit.rmse == fit.json["rmse_V"]


def test_covariance_is_of_the_free_parameters(fit):
    n = len(fit.free)
    assert n and fit.covariance.shape == fit.correlation.shape == (n, n)
    assert fit.covariance.dtype == np.float64
    known = [i for i, name in enumerate(fit.free) if fit.parameters[name].std_error is not None]
    assert len(known) > 1
    for i in known:
        error = fit.parameters[fit.free[i]].std_error
        assert fit.covariance[i, i] == pytest.approx(error**2)
    np.testing.assert_allclose(np.diag(fit.correlation), 1.0)
    np.testing.assert_allclose(fit.covariance, fit.covariance.T)


def test_the_report_shows_in_a_notebook(fit):
    page = fit.report()
    assert page.lstrip().lower().startswith("<!doctype html") and "</html>" in page
    inline = fit._repr_html_()
    assert inline.startswith("<iframe srcdoc=") and inline.endswith("</iframe>")
    inside = inline.split('srcdoc="', 1)[1].split('"', 1)[0]
    assert inside.replace("&quot;", '"').replace("&amp;", "&") == page


def test_files_are_saved_all_at_once_and_not_over_others(fit, tmp_path):
    written = fit.save(tmp_path / "out")
    assert sorted(p.name for p in written) == sorted(fit.files)
    assert set(fit.files) == {"report.html", "parameters.toml", "fit.json", "plan.toml"}
    assert (tmp_path / "out" / "report.html").read_text() == fit.report()
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "fit.json").write_text("my own")
    with pytest.raises(deacal.DeacalError, match="fit.json"):
        fit.save(tmp_path / "mine")
    assert (tmp_path / "mine" / "fit.json").read_text() == "my own"
    assert not (tmp_path / "mine" / "report.html").exists()
    fit.save(tmp_path / "mine", force=True)
    assert (tmp_path / "mine" / "fit.json").read_text() != "my own"


def test_a_parameter_file_reads_back_to_the_same_bits(fit, tmp_path):
    fit.parameter_file.save(tmp_path / "p.toml")
    again = deacal.ParameterFile.read(tmp_path / "p.toml")
    assert again.text == fit.parameter_file.text
    film = again.to_dict()["film"]
    assert film["mu_Pa"][0] == fit.parameters["mu_1"].value


def test_a_result_says_how_it_was_made(fit):
    command = fit.json["provenance"]["command"]
    assert command.startswith("deacal.fit_film([") and "branches=2" in command and "seed" not in command


def test_a_validation_says_how_far_each_prediction_is():
    held_out = deacal.read(bench.TWIN / "circle-3s")
    poor, good = bench.fitted("film"), deacal.library["twin2026_delta"]
    both = deacal.validate(held_out, [good, poor])
    assert len(both.answers) == 2 and both.says == both.answers[0] != both.answers[1]
    assert both.rmse_unit == "V" and 0.0 < both.rmse < 1.25 * both.noise_floor
    assert both.json["compared"][0]["rmse_V"] > both.rmse
    assert both.json["compared"][0]["rmse_V"] == deacal.validate(held_out, poor).rmse
    assert [r["id"] for r in both.recordings] == [held_out.id] and both.recordings[0]["path"]
    assert set(both.files) == {"validation.json", "report.html"} and both.report()
    assert "library:twin2026_delta" in both.json["provenance"]["command"]


def test_a_diagnosis_names_what_was_left_out(rubbing):
    found = deacal.diagnose(rubbing[:1], holdout=rubbing[1], only=["joint_friction", "leakage"])
    assert found.verdict == "missing_physics" and found.candidates[0]["effect"] == "joint_friction"
    assert found.candidates[0]["in_model"] and 0.5 < found.confidence <= 1.0
    assert found.findings == [] and found.places and found.says
    assert 'id = "joint_friction"' in found.parameter_file.text
    assert "next_experiment.csv" in found.files
    told = deacal.predict(rubbing[1], found)
    assert "film1_V" not in told and len(told) == 2501


def test_electrodes_that_stiffen_lose_stroke(samples):
    aged = deacal.ageing(samples, cycles=4)
    days = aged.electrodes["CGE"]
    assert [d["day"] for d in days] == [1, 8]
    assert days[1]["change_percent"]["value"] < -5 and days[1]["relevant"]
    assert aged.says and "CGE" in aged.causes
    assert "ageing.json" in aged.files and aged.report()
