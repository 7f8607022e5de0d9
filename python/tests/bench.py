"""The same jobs asked of the program and of the package, and what a user would have beside recordings."""

import functools
import json
import subprocess
from pathlib import Path

import deacal

ROOT = Path(__file__).resolve().parents[2]
TWIN = ROOT / "datasets" / "twin2026_delta"
COUPON = ROOT / "datasets" / "miles2015_vhb4910"
AXIS = ROOT / "fits" / "silverbox2013" / "multisine"
HINGE = Path(__file__).parent / "data" / "hinge"
RIG = TWIN / "rig.toml"

TRUTH = """\
[film]
mu_Pa = [1120e3, 220e3, 120e3]
T_s = [0.1, 4.0]
J = 80.0
eps_r = 2.8

[forearm]
nodes_deg = [-30.0, -20.0, -10.0, 0.0, 10.0, 20.0, 30.0]
torque_N_m = [-1.6e-3, -0.8e-3, -0.3e-3, 0.0, 0.3e-3, 0.8e-3, 1.6e-3]
"""

HANGING = """\
[rig]
id = "hanging"
kind = "film-sample"

[sample]
width_mm = 45.0
length_mm = 60.0
margin_mm = 3.0

[film]
L3_mm = 0.1
eps_r = 2.8

[mass]
m_g = 50.0
"""

SINE = "sine:peak_V=4000,hz=0.5"

# Jobs whose parameters are golden: on recordings that come with the source.
ON_DATA = {
    "film": (
        ["fit", "film", TWIN / "symmetric", "--branches", "2", "--starts", "2"],
        lambda: deacal.fit_film(TWIN / "symmetric", branches=2, starts=2),
    ),
    "robot": (
        ["fit", "robot", TWIN / "symmetric", TWIN / "single-1", "--branches", "2", "--starts", "1"]
        + ["--fix", "torque_0deg=0", "--bound", "J=20..200", "--robust", "3", "--seed", "5"],
        lambda: deacal.fit_robot(
            [TWIN / "symmetric", deacal.read(TWIN / "single-1")],
            branches=2,
            starts=1,
            fix={"torque_0deg": 0.0},
            bound={"J": (20.0, 200.0)},
            robust=3.0,
            seed=5,
        ),
    ),
    "coupon": (
        ["fit", "coupon", COUPON, "--branches", "2"],
        lambda: deacal.fit_coupon(deacal.read(COUPON), branches=2),
    ),
    "hinge": (["fit", "hinge", HINGE], lambda: deacal.fit_hinge(HINGE)),
    "axis": (["fit", "axis", AXIS], lambda: deacal.fit_axis([AXIS])),
    "axis, its motion": (
        ["fit", "axis", AXIS, "--objective", "motion", "--between", "straight"],
        lambda: deacal.fit_axis(AXIS, objective="motion", between="straight"),
    ),
}


@functools.cache
def fitted(name):
    """A fit of the table, made once."""
    return ON_DATA[name][1]()


def ask(program, arguments, folder):
    """What the program says in JSON; its files go to `folder`."""
    words = [program, *map(str, arguments), "--json", "--quiet", "-o", str(folder)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def without_command(result):
    """A result without how it was asked for, which is the only difference there may be."""
    result["provenance"].pop("command")
    return result
