"""The studies run from end to end on a small studio; more cameras are better."""

import json
from dataclasses import replace

import numpy as np
import pytest
from blobs import Blobs

from panoptic_ros.bench.studies import resolution, times
from panoptic_ros.bench.studies.cameras import study_cameras
from panoptic_ros.bench.studies.solving import SCORED
from panoptic_ros.bench.studies.takes import Method, Takes
from panoptic_ros.cli.main import main
from panoptic_ros.detection.model import DetectorModel
from panoptic_ros.domain import JointMap, Rig, ViewFrame
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.running.plans.presets import read_preset
from panoptic_ros.running.studies.rigs import StudyRequest
from panoptic_ros.simulation import CLEAN, SKELETON, Lens, PanelDome, Ring, simulate
from panoptic_ros.simulation.studio import study_scene
from panoptic_ros.stage import StageContext, untold
from panoptic_ros.view.study_plots import write_study_plot
from panoptic_ros.view.study_table import duration, study_table, time_table

RIG = PanelDome(2).build(np.random.default_rng(0))


def test_more_cameras_are_better_and_people_can_be_compared(tmp_path):
    told = []
    takes = Takes((2, 3), 4)
    found = study_cameras(RIG, takes, [500, 8], [Method()], lambda share, doing: told.append(share))
    rows = {(row["people"], row["cameras"]): row for row in found["rows"]}
    assert set(rows) == {(2, 40), (2, 8), (3, 40), (3, 8)}
    assert told == sorted(told) and told[-1] == 1.0
    for people in (2, 3):
        many, few = rows[people, 40], rows[people, 8]
        assert many["nodes"] == few["nodes"] == 4 * people * len(SCORED)
        assert many["median_mm"] < few["median_mm"] and many["node_accuracy"] > 0.97
    text = "\n".join(study_table(json.loads(json.dumps(found))))
    assert "40 cameras, default: 20 skeletons, 300 nodes" in text
    write_study_plot(tmp_path / "plot.png", found["rows"], "title")
    assert (tmp_path / "plot.png").stat().st_size > 10_000


def test_a_setting_changes_nothing_but_its_parameter():
    """A default that is given again gives the same numbers: instants are still solved one by one."""
    expected, found = (
        study_cameras(RIG, Takes((2,), 5), [8], [Method(settings=settings)], untold)["rows"]
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
    assert [row["method"] for row in document["rows"]] == ["default", "panoptic-studio"]
    assert (tmp_path / "out" / "nodes.png").exists()
    assert main(["evaluate", "--study", "nodes", *options, "--frames", "2", "--preset", "none"]) == 0
    document = json.loads((tmp_path / "out" / "nodes.json").read_text())
    assert [row["method"] for row in document["rows"]] == ["default"]


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
    hd, vga = (
        Ring(3, lens=Lens(size, focal)).build(np.random.default_rng(1))
        for size, focal in (((192, 108), (110.0, 140.0)), ((64, 48), (44.0, 52.0)))
    )
    vga = Rig(tuple(replace(camera, name=f"low_{camera.name}") for camera in vga.cameras))
    take = simulate(study_scene(Rig((*hd.cameras, *vga.cameras)), 1, 1.0, CLEAN), 0, 1)
    images = resolution._render(take, untold)
    kinds = resolution._kinds(take, set(hd.names), images)
    assert [(kind, len(rig), rig.cameras[0].image_size) for kind, rig, _ in kinds] == [
        ("HD", 3, (192, 108)),
        ("VGA", 3, (64, 48)),
        ("QVGA", 3, (32, 24)),
    ]
    for _, rig, views in kinds:
        width, height = rig.cameras[0].image_size
        assert all(views[name][0].shape == (height, width, 3) for name in rig.names)
    low, lowest = kinds[1][2]["low_cam00"][0], kinds[2][2]["low_cam00"][0]
    assert lowest.mean() == pytest.approx(low.mean(), abs=1.0)


def test_the_preset_stands_beside_the_default():
    """With many views both place nearly all joints; settings of the user reach both."""
    settings, paper = {"voting": {"voxel": 0.05}}, read_preset("panoptic-studio")
    request = StudyRequest("nodes", "rig", Takes((2,), 4), (40,), settings, paper)
    default, paper = request.methods
    assert default.settings == {"voting": {"voxel": 0.05}} and default.skeleton == ""
    voting = paper.settings["voting"]
    assert voting["voxel"] == 0.05 and voting["method"] == "exact"
    rows = study_cameras(RIG, request.takes, [40], [default, paper], untold)["rows"]
    assert [row["method"] for row in rows] == ["default", "panoptic-studio"]
    assert all(row["nodes"] == 4 * 2 * len(SCORED) and row["node_accuracy"] > 0.9 for row in rows)


def test_the_time_of_a_minute_is_that_of_its_instants(monkeypatch):
    monkeypatch.setattr(times, "_detection_s", lambda rig, takes, model: 0.2)
    small = RIG.subset(RIG.names[::5])
    found = times.study_time(small, Takes((2,), 3), [Method()], "none", untold)
    (row,) = found["rows"]
    assert found["instants"] == 1500 and row["cameras"] == 8
    assert row["seconds"]["detection"] == pytest.approx(0.2 * 8 * 1500)
    assert row["seconds"]["voting"] > 0.0 < row["seconds"]["assembly"]
    head, names, detection, *_ = time_table(json.loads(json.dumps(found)))
    assert "1500 instants, 8 views, 2 people" in head and names.split() == ["default"]
    assert detection.endswith("40 m")


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.04, "0.0 s"), (119.0, "119.0 s"), (150.0, "2 m"), (1e5, "27.8 h")]
)
def test_times_are_told_in_the_unit_that_suits_them(seconds, text):
    assert duration(seconds) == text


def test_detection_is_timed_on_all_instants_but_the_first():
    rig = Ring(2, lens=Lens((256, 192), (150.0, 150.0))).build(np.random.default_rng(0))
    network = Blobs.heads_network([-10, -2, 0, 0, 10, 2])
    joints = JointMap(3, tuple((j,) if j < 3 else () for j in range(len(SKELETON))))
    extras = {"detector": DetectorModel(Blobs.heads_card(), network), "joint_map": joints}
    image = Blobs.picture((192, 256), np.full((1, 3, 2), 100.0), 4.0)
    instants = [[ViewFrame(name, 40_000_000 * k, k, image) for name in rig.names] for k in range(3)]
    assert times.seconds_per_image(StageContext(rig, SKELETON, extras), instants) > 0.0
