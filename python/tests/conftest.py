import os

import bench
import deacal
import pytest


@pytest.fixture(scope="session")
def program():
    """The program to hold the package against."""
    path = os.environ.get("DEACAL_BIN")
    if not path:
        pytest.skip("DEACAL_BIN names no program to compare with")
    return path


@pytest.fixture(scope="session")
def truth(tmp_path_factory):
    """Parameters that are known."""
    path = tmp_path_factory.mktemp("truth") / "parameters.toml"
    path.write_text(bench.TRUTH)
    return path


@pytest.fixture(scope="session")
def hanging(tmp_path_factory):
    """The rig of a hanging sample."""
    path = tmp_path_factory.mktemp("rig") / "hanging.toml"
    path.write_text(bench.HANGING)
    return path


@pytest.fixture(scope="session")
def rubbing(tmp_path_factory, truth):
    """Two recordings of a robot whose joints rub."""
    folder = tmp_path_factory.mktemp("rubbing")
    friction = "joint_friction:torque=1.5e-3,presliding=6e-3"
    for i, drive in enumerate(["multisine:peak_V=4500,hz=0.1/0.3/0.7", bench.SINE]):
        made = deacal.simulate(
            bench.RIG, truth, drive=drive, duration=25.0, noise=0.02, seed=i, id=f"{i}", effects=[friction]
        )
        assert made.effects[0]["effect"] == "joint_friction"
        made.save(folder / f"{i}")
    return [folder / "0", folder / "1"]


@pytest.fixture(scope="session")
def samples(tmp_path_factory, truth, hanging):
    """Recordings of a hanging sample on two days, the electrode stiffer on the second."""
    folder = tmp_path_factory.mktemp("samples")
    for day, factor in [(1, 1.0), (8, 1.3)]:
        film = deacal.ParameterFile.read(truth).to_dict()["film"]
        stiffer = folder / f"{day}.toml"
        mu = [factor * mu for mu in film["mu_Pa"]]
        stiffer.write_text(bench.TRUTH.replace("[1120e3, 220e3, 120e3]", str(mu)))
        deacal.simulate(
            hanging, stiffer, drive=bench.SINE, duration=16.0, noise=0.01, seed=day, id=f"day-{day}",
            electrode="CGE", day=day,
        ).save(folder / f"day-{day}")
    return [folder / "day-1", folder / "day-8"]
