"""The studies run from end to end on a small studio; more cameras are better."""
import json
from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.bench.studies import resolution
from panoptic_ros.bench.studies.cameras import study_cameras
from panoptic_ros.bench.studies.solving import SCORED
from panoptic_ros.cli.main import main
from panoptic_ros.domain import Rig
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.simulation import CLEAN, Lens, PanelDome, Ring, simulate
from panoptic_ros.simulation.studio import study_scene
from panoptic_ros.stage import untold
from panoptic_ros.view.study_plots import write_study_plot
from panoptic_ros.view.study_table import study_table

RIG = PanelDome(2).build(np.random.default_rng(0))


def test_more_cameras_are_better_and_people_can_be_compared(tmp_path):
    told = []
    found = study_cameras(RIG, [2, 3], [500, 8], 4, 0, 0.012, {}, lambda share, doing: told.append(share))
    rows = {(row["people"], row["cameras"]): row for row in found["rows"]}
    assert set(rows) == {(2, 40), (2, 8), (3, 40), (3, 8)}
    assert told == sorted(told) and told[-1] == 1.0
    for people in (2, 3):
        many, few = rows[people, 40], rows[people, 8]
        assert many["nodes"] == few["nodes"] == 4 * people * len(SCORED)
        assert many["median_mm"] < few["median_mm"] and many["node_accuracy"] > 0.97
    text = "\n".join(study_table(json.loads(json.dumps(found["rows"]))))
    assert "40 cameras: 20 skeletons, 300 nodes" in text
    write_study_plot(tmp_path / "plot.png", found["rows"], "title")
    assert (tmp_path / "plot.png").stat().st_size > 10_000


def test_a_setting_changes_nothing_but_its_parameter():
    """A default that is given again gives the same numbers: instants are still solved one by one."""
    expected, found = (
        study_cameras(RIG, [2], [8], 5, 0, 0.012, settings, untold)["rows"]
        for settings in ({}, {"association": {"min_views": 3}, "voting": {"voxel": 0.04}})
    )
    assert found == expected


def test_the_command_writes_numbers_and_a_plot(tmp_path, capsys):
    write_rig(tmp_path / "rig.json", RIG.subset(RIG.names[::4]))
    options = ["--rig", str(tmp_path / "rig.json"), "--out", str(tmp_path / "out"), "--people", "2"]
    assert main(["evaluate", "--study", "nodes", *options, "--frames", "2"]) == 0
    assert "node acc." in capsys.readouterr().out
    document = json.loads((tmp_path / "out" / "nodes.json").read_text())
    assert document["study"] == "nodes" and document["rows"][0]["cameras"] == 10
    assert (tmp_path / "out" / "nodes.png").exists()


def test_an_interruption_leaves_no_file(tmp_path, capsys, monkeypatch):
    def interrupt(bar, share, doing):
        if share > 0.5:
            raise KeyboardInterrupt

    monkeypatch.setattr("panoptic_ros.view.progress.PassBar.show", interrupt)
    write_rig(tmp_path / "rig.json", RIG.subset(RIG.names[::4]))
    options = ["--rig", str(tmp_path / "rig.json"), "--out", str(tmp_path / "out"), "--people", "2"]
    assert main(["evaluate", "--study", "nodes", *options, "--frames", "2"]) == 2
    assert capsys.readouterr().err == "panoptic evaluate: interrupted\n"
    assert [path.name for path in tmp_path.iterdir()] == ["rig.json"]


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--study", "cameras"], "needs --rig FILE and --out DIR"),
        (["truth.json", "--study", "cameras"], "leave out truth.json"),
        (["--study", "cameras", "--rig", "r", "--out", "o", "--noise", "2"], "no share"),
        ([], "name the truth and the result"),
        (["--study", "stars"], "invalid choice"),
    ],
)
def test_mistakes_are_told_in_one_line(options, told, capsys):
    assert main(["evaluate", *options]) == 2
    assert told in capsys.readouterr().err


def test_a_list_that_is_none_is_told(tmp_path, capsys):
    write_rig(tmp_path / "rig.json", RIG)
    options = ["--rig", str(tmp_path / "rig.json"), "--out", str(tmp_path), "--people", "0,2"]
    assert main(["evaluate", "--study", "cameras", *options]) == 2
    assert "--people '0,2' is no list" in capsys.readouterr().err


def test_resolutions_are_the_same_scene_in_other_pixels():
    hd, vga = (Ring(3, lens=Lens(size, focal)).build(np.random.default_rng(1))
               for size, focal in (((192, 108), (110.0, 140.0)), ((64, 48), (44.0, 52.0))))  # fmt: skip
    vga = Rig(tuple(replace(camera, name=f"low_{camera.name}") for camera in vga.cameras))
    take = simulate(study_scene(Rig((*hd.cameras, *vga.cameras)), 1, 1.0, CLEAN), 0, 1)
    images = resolution._render(take, untold)
    kinds = resolution._kinds(take, set(hd.names), images)
    assert [(kind, len(rig), rig.cameras[0].image_size) for kind, rig, _ in kinds] == [
        ("HD", 3, (192, 108)), ("VGA", 3, (64, 48)), ("QVGA", 3, (32, 24)),
    ]  # fmt: skip
    for _, rig, views in kinds:
        width, height = rig.cameras[0].image_size
        assert all(views[name][0].shape == (height, width, 3) for name in rig.names)
    low, lowest = kinds[1][2]["low_cam00"][0], kinds[2][2]["low_cam00"][0]
    assert lowest.mean() == pytest.approx(low.mean(), abs=1.0)
