"""A robot with another array, from a set to a map: on the ReSpeaker above its loudspeaker."""

import csv

import numpy as np
import pytest

from echolearn.cli.main import main

LABEL = ["target=reflector", "aim=balanced"]


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Return the folder in which everything has been made with that array, and mapped."""
    place = tmp_path_factory.mktemp("respeaker")
    own = ["scene=respeaker", f"runs={place}"]
    few = ["plan=tiny_scattered", "plan.rows=40", "plan.shard_rows=40", "localizer=joint"]
    assert main(["generate", *few, "engine=serial", *own]) == 0
    assert main(["train", *few, "classifier=threshold_score", *LABEL, *own]) == 0
    run = next((place / "train").iterdir())
    assert main(["export", f"run={run}", "name=board", "resamples=20", *own]) == 0
    assert main(["survey", "room=8x6x5", "snr_db=20", "poses=20", "name=walk", *own]) == 0
    mapped = [f"survey={place}/survey/walk", f"bundle={place}/bundles/board", f"runs={place}"]
    assert main(["map", *mapped]) == 0
    return place


def test_what_it_keeps_lies_on_walls(runs):
    with (runs / "maps" / "walk-board" / "map.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["kept"] == "1"]
    walls = [row for row in rows if row["floor_or_ceiling"] == "0"]
    x, y = np.array([[float(row["x_m"]), float(row["y_m"])] for row in walls]).T
    off = np.abs([x, x - 8.0, y, y - 6.0]).min(axis=0)
    assert len(off) >= 6
    assert np.mean(off < 0.1) > 0.9
    # Seen from 8 cm above the loudspeaker, mirror sources are a little below.
    tilt = np.degrees([float(row["elevation_rad"]) for row in walls]) - 90.0
    assert (tilt > 0.9).all() and (tilt < 2.6).all()


def test_another_robot_refuses_its_bundle(runs, tmp_path, capsys):
    assert (
        main(["survey", "room=8x6x5", "snr_db=20", "poses=4", "name=ring", f"runs={tmp_path}"]) == 0
    )
    capsys.readouterr()
    words = ["map", f"survey={tmp_path}/survey/ring", f"bundle={runs}/bundles/board"]
    assert main([*words, f"runs={tmp_path}"]) == 1
    [line] = capsys.readouterr().err.splitlines()
    assert "microphones=6: must be 4, the bundle's; " in line and "was made for 4" in line
