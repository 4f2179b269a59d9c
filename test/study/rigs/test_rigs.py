"""The studies run from end to end on a small studio; more cameras are better."""

import json
from dataclasses import replace

import numpy as np
import pytest
from blobs import Blobs

from panoptic_ros.cli.main import main
from panoptic_ros.detection.model import DetectorModel
from panoptic_ros.domain import JointMap, Rig, ViewFrame
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.simulation import CLEAN, SKELETON, Lens, PanelDome, Ring, simulate
from panoptic_ros.simulation.studio import study_scene
from panoptic_ros.stage import StageContext, untold
from panoptic_ros.study.names import parsed
from panoptic_ros.study.rigs import resolution, times
from panoptic_ros.study.rigs.solving import SCORED
from panoptic_ros.study.rigs.times import duration
from panoptic_ros.study.study import run_study

RIG = PanelDome(2).build(np.random.default_rng(0))


@pytest.fixture
def rig(tmp_path):
    """The option that names 40 cameras."""
    write_rig(tmp_path / "rig.json", RIG)
    return ["--rig", str(tmp_path / "rig.json")]


def test_more_cameras_are_better_and_people_can_be_compared(tmp_path, rig):
    told = []
    few = ["--people", "2,3", "--frames", "4", "--cameras", "500,8", "--preset", "none"]
    study = parsed("cameras", [*rig, *few])
    found = run_study(study, lambda share, doing: told.append(share))
    rows = {(row["people"], row["cameras"]): row for row in found["rows"]}
    assert set(rows) == {(2, 40), (2, 8), (3, 40), (3, 8)}
    assert told == sorted(told) and told[-1] == 1.0
    for people in (2, 3):
        many, few = rows[people, 40], rows[people, 8]
        assert many["nodes"] == few["nodes"] == 4 * people * len(SCORED)
        assert many["median_mm"] < few["median_mm"] and many["node_accuracy"] > 0.97
    text = "\n".join(study.lines(json.loads(json.dumps(found))))
    assert "40 cameras, default: 20 skeletons, 300 nodes" in text
    study.plot(tmp_path / "plot.png", found)
    assert (tmp_path / "plot.png").stat().st_size > 10_000


def test_a_setting_changes_nothing_but_its_parameter(rig):
    """A default that is given again gives the same numbers: instants are still solved one by one."""
    few = ["--people", "2", "--frames", "5", "--cameras", "8", "--preset", "none"]
    expected, found = (
        run_study(parsed("cameras", [*rig, *few, *settings]))["rows"]
        for settings in ([], ["--set", "association.min_views=3", "--set", "voting.voxel=0.04"])
    )
    assert found == expected


def test_the_command_writes_numbers_and_a_plot(tmp_path, capsys):
    write_rig(tmp_path / "rig.json", RIG.subset(RIG.names[::4]))
    files = ["--json", str(tmp_path / "nodes.json"), "--plot", str(tmp_path / "nodes.png")]
    options = ["--rig", str(tmp_path / "rig.json"), "--people", "2", "--frames", "2"]
    assert main(["study", "nodes", *options, *files]) == 0
    assert "node acc." in capsys.readouterr().out
    document = json.loads((tmp_path / "nodes.json").read_text())
    assert document["study"] == "nodes" and document["rows"][0]["cameras"] == 10
    assert [row["method"] for row in document["rows"]] == ["default", "panoptic-studio"]
    assert (tmp_path / "nodes.png").exists()


def test_an_interruption_leaves_no_file(tmp_path, capsys, monkeypatch):
    def interrupt(bar, share, doing):
        if share > 0.05:
            raise KeyboardInterrupt

    monkeypatch.setattr("panoptic_ros.view.progress.PassBar.show", interrupt)
    write_rig(tmp_path / "rig.json", RIG.subset(RIG.names[::4]))
    options = ["--rig", str(tmp_path / "rig.json"), "--people", "2", "--frames", "2"]
    assert main(["study", "nodes", *options, "--json", str(tmp_path / "nodes.json")]) == 2
    assert capsys.readouterr().err == "panoptic study: interrupted\n"
    assert [path.name for path in tmp_path.iterdir()] == ["rig.json"]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["study", "cameras"], "required: --rig"),
        (["study", "cameras", "--rig", "r", "--noise", "2"], "'2' is not a number from"),
        (["study", "cameras", "--rig", "r", "--people", "0,2"], "'0,2' is not a list"),
        (["study", "cameras", "--rig", "r", "--depth", "none"], "unrecognized arguments: --depth"),
        (["study", "stars"], "no study 'stars'"),
        (["evaluate"], "name the truth and the result"),
        (["evaluate", "--study", "cameras"], "is now `panoptic study cameras`"),
        (["bench", "kinematics"], "it is now `panoptic study kinematics-time`"),
    ],
)
def test_mistakes_are_told_in_one_line(arguments, told, capsys):
    assert main(arguments) == 2
    error = capsys.readouterr().err.strip()
    assert told in error and "\n" not in error


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


def test_the_preset_stands_beside_the_default(rig):
    """With many views both place nearly all joints; settings of the user reach both."""
    study = parsed("nodes", [*rig, "--people", "2", "--frames", "4", "--set", "voting.voxel=0.05"])
    default, paper = study.methods
    assert default.settings == {"voting": {"voxel": 0.05}} and default.skeleton == ""
    voting = paper.settings["voting"]
    assert voting["voxel"] == 0.05 and voting["method"] == "exact"
    rows = run_study(study)["rows"]
    assert [row["method"] for row in rows] == ["default", "panoptic-studio"]
    assert all(row["nodes"] == 4 * 2 * len(SCORED) and row["node_accuracy"] > 0.9 for row in rows)


def test_the_time_of_a_minute_is_that_of_its_instants(tmp_path, monkeypatch):
    monkeypatch.setattr(times, "_detection_s", lambda rig, people, seed: 0.2)
    write_rig(tmp_path / "rig.json", RIG.subset(RIG.names[::5]))
    few = ["--people", "2", "--frames", "3", "--preset", "none"]
    study = parsed("time", ["--rig", str(tmp_path / "rig.json"), *few])
    found = run_study(study)
    (row,) = found["rows"]
    assert row["cameras"] == 8 and row["seconds"]["detection"] == pytest.approx(0.2 * 8 * 1500)
    assert row["seconds"]["voting"] > 0.0 < row["seconds"]["assembly"]
    head, _, *lines = study.lines(json.loads(json.dumps(found)))
    assert "1500 instants" in head and any(line.endswith("40 m") for line in lines)


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
