"""Parameter sets that come with the package."""

import html
import json
import re
import subprocess

import bench
import deacal
import numpy as np
import pytest

FITS = bench.ROOT / "fits"
FOLDERS = {"silverbox2013": "silverbox2013_official"}


def said(name):
    """What is said of a set by hand: plain TOML, a line a key."""
    lines = (FITS / FOLDERS.get(name, name) / "library.toml").read_text().splitlines()
    return {key: json.loads(text) for key, text in (line.split(" = ", 1) for line in lines)}


def test_the_library_is_a_mapping_by_name():
    names = list(deacal.library)
    assert names == deacal.library.keys() == sorted(names) and "twin2026_delta" in names
    assert len(deacal.library) == len(names) == len(list(FITS.glob("*/library.toml")))
    assert dict(deacal.library).keys() == dict(deacal.library.items()).keys() == set(names)
    assert [of.name for of in deacal.library.values()] == names
    assert "twin2026_delta" in deacal.library and "twin" not in deacal.library and 3 not in deacal.library
    with pytest.raises(KeyError, match="no parameter set `twin`.*twin2026_delta"):
        deacal.library["twin"]


@pytest.mark.parametrize("name", list(deacal.library))
def test_a_set_says_where_it_comes_from_and_how_far_it_goes(name):
    of = deacal.library[name]
    assert isinstance(of, deacal.ParameterFile) and of.name == name
    for key, text in said(name).items():
        assert getattr(of, key) == text, key
    assert of.text == deacal.ParameterFile.read(f"library:{name}").text
    folder = FITS / FOLDERS.get(name, name)
    assert of.to_dict() == deacal.ParameterFile.read(folder / "parameters.toml").to_dict()
    assert of.of in repr(of)


def test_the_program_lists_the_same_sets(program):
    done = subprocess.run([program, "library", "--json"], capture_output=True, text=True, check=True)
    keys = ["name", "of", "made_by", "source", "licence", "range", "beyond"]
    ours = [{key: getattr(of, key) for key in keys} for of in deacal.library.values()]
    assert ours == json.loads(done.stdout)


def test_a_notebook_shows_a_table():
    page = deacal.library._repr_html_()
    rows = re.findall("<tr><td>(.*?)</td></tr>", page)
    assert len(rows) == len(deacal.library)
    for row, of in zip(rows, deacal.library.values()):
        cells = [html.unescape(cell) for cell in row.split("</td><td>")]
        assert cells == [of.name, of.of, of.range, of.licence]


@pytest.mark.parametrize("as_given", [lambda name: f"library:{name}", lambda name: deacal.library[name]])
def test_a_set_is_taken_wherever_parameters_are(as_given):
    twin = as_given("twin2026_delta")
    file = FITS / "twin2026_delta" / "parameters.toml"
    recording = bench.TWIN / "single-1"
    for what in ["voltage", "force"]:
        ours, theirs = (deacal.predict(recording, p, what) for p in [twin, file])
        for column in theirs.keys():
            np.testing.assert_array_equal(ours[column], theirs[column])
    options = {"drive": bench.SINE, "duration": 1.0}
    ours, theirs = (deacal.simulate(bench.RIG, p, **options) for p in [twin, file])
    np.testing.assert_array_equal(ours["z_mm"], theirs["z_mm"])
    options = {"starts": 1, "fix": {"torque_0deg": 0.0}}
    ours, theirs = (deacal.fit_forearm(recording, start=p, **options) for p in [twin, file])
    assert [of.value for of in ours.parameters.values()] == [of.value for of in theirs.parameters.values()]
    ours, theirs = (deacal.validate(recording, p).json for p in [twin, file])
    assert ours["params"].pop("file") == "library:twin2026_delta"
    for said in [ours, theirs]:
        said.pop("params")
        bench.without_command(said)
    assert ours == theirs


def test_a_set_that_is_not_there_is_answered_with_those_that_are():
    with pytest.raises(deacal.DeacalError, match="no parameter set `twin`.*twin2026_delta"):
        deacal.predict(bench.TWIN / "single-1", "library:twin")


def test_a_set_is_saved_as_a_file(tmp_path):
    of = deacal.library["miles2015_vhb4910"]
    of.save(tmp_path / "parameters.toml")
    assert deacal.ParameterFile.read(tmp_path / "parameters.toml").text == of.text
