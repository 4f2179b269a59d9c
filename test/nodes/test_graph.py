"""The graph over DDS gives the same bytes as the pipeline, and each bag the same bytes every time."""

import gzip
import json
from dataclasses import replace

import captures
import numpy as np
import pytest
from free_cameras import FreeCapture
from recordings import write_bag
from rolling import rolling_points, with_line_delays
from walkers import turned, walk

from panoptic_ros.cli.main import main
from panoptic_ros.domain import AssociationSet, Occluders, Rig, VisibilityLimit
from panoptic_ros.io.bags import BagReader
from panoptic_ros.io.messages import from_message
from panoptic_ros.io.plain_formats import read_skeletons, write_skeletons

pytest.importorskip("rclpy")
pytestmark = pytest.mark.ros


def skeletons(out):
    return (out / "skeletons.json.gz").read_bytes()


@pytest.fixture(scope="module")
def over_dds(recorded, tmp_path_factory):
    out = tmp_path_factory.mktemp("dds") / "out"
    assert main(["run", "--bag", str(recorded), "--out", str(out), "--no-pictures"]) == 0
    return out


def test_graph_and_pipeline_give_identical_bytes(over_dds, recorded, tmp_path):
    out = tmp_path / "out"
    arguments = ["run", "--bag", str(recorded), "--out", str(out), "--no-pictures", "--in-process"]
    assert main(arguments) == 0
    assert skeletons(out) == skeletons(over_dds)


def test_feedback_gives_the_same_bytes_in_one_process_and_in_one_node(tmp_path):
    """Clocks from motion go back to sync, which moves the views that come after."""
    late = {"cam1": 40_000_000, "cam3": -30_000_000}  # ns
    views = [replace(v, stamp_ns=v.stamp_ns + 10**9 + late.get(v.camera, 0)) for v in captures.views(75)]
    bag = write_bag(tmp_path / "bag", views)
    settings = ["offsets.active=true", "offsets.block_s=0.5", "offsets.trusted_camera=cam0"]
    common = ["run", "--bag", str(bag), "--no-pictures", *(f"--set={text}" for text in settings)]
    for out, more in (("process", ["--in-process"]), ("node", [])):
        assert main([*common, "--out", str(tmp_path / out), *more]) == 0
    assert json.loads((tmp_path / "process" / "offsets.json").read_text())
    assert skeletons(tmp_path / "node") == skeletons(tmp_path / "process")


def test_instants_of_free_cameras_are_the_same_in_one_process_and_in_one_node(tmp_path):
    """Cameras that expose one after the other; clocks of two of them are found meanwhile."""
    capture = FreeCapture(seconds=2.5, offsets=[0.0, 0.03, 0.0, 0.0, -0.02, 0.0])
    bag = write_bag(tmp_path / "bag", [item.views[0] for item in capture.sets], capture.rig)
    settings = ["continuous.active=true", "offsets.active=true", "offsets.block_s=0.5"]
    common = ["run", "--bag", str(bag), "--no-pictures", *(f"--set={text}" for text in settings)]
    found = {}
    for out, more in (("process", ["--in-process"]), ("node", [])):
        assert main([*common, "--out", str(tmp_path / out), *more]) == 0
        with BagReader(tmp_path / out / "bag") as bag_of_run:
            found[out] = [str(message) for _, _, message in bag_of_run.messages("/skeletons_at")]
    assert len(found["node"]) > 100 and found["node"] == found["process"]


def test_instants_of_a_bag_are_those_of_the_graph(tmp_path):
    """`panoptic continuous --lag` reads the bag, a run in one process and one with nodes play it."""
    capture = FreeCapture(seconds=2.0)
    bag = write_bag(tmp_path / "bag", [item.views[0] for item in capture.sets], capture.rig)
    words = ["--bag", str(bag), "--lag", "0.05", "--rate", "40", "--out", str(tmp_path / "bag.json.gz")]
    assert main(["continuous", *words]) == 0
    settings = [f"--set=continuous.{text}" for text in ("active=true", "lag=0.05", "rate_hz=40")]
    for out, more in (("process", ["--in-process"]), ("node", [])):
        run = ["run", "--bag", str(bag), "--no-pictures", *settings, "--out", str(tmp_path / out), *more]
        assert main(run) == 0
        with BagReader(tmp_path / out / "bag") as bag_of_run:
            sets = [
                from_message(message, "RefinedPoseSet")
                for _, _, message in bag_of_run.messages("/skeletons_at")
            ]
        write_skeletons(tmp_path / f"{out}.json.gz", captures.SKELETON.joint_names, sets)
        assert (tmp_path / f"{out}.json.gz").read_bytes() == (tmp_path / "bag.json.gz").read_bytes()
    assert len(read_skeletons(tmp_path / "bag.json.gz").frames) == 79


def test_rolling_shutters_give_the_same_bytes_with_and_without_ros(tmp_path):
    """People in motion, of whom each image row shows another instant."""
    rig, views = with_line_delays(captures.RIG, (30.0, 20.0, 40.0)), []
    rng = np.random.default_rng(0)
    for view in captures.views(20):
        stamp = view.stamp_ns + 10**9
        points = rolling_points(rig.camera(view.camera), captures.people, 1e-9 * stamp)
        points = points + 0.2 * rng.standard_normal(points.shape)
        points = np.where(view.scores[..., None] > 0.0, points, np.nan)
        views.append(replace(view, stamp_ns=stamp, points=points))
    bag = write_bag(tmp_path / "bag", views, rig)
    for out, more in (("dds", []), ("process", ["--in-process"])):
        assert main(["run", "--bag", str(bag), "--out", str(tmp_path / out), "--no-pictures", *more]) == 0
    assert skeletons(tmp_path / "dds") == skeletons(tmp_path / "process")
    for frame in read_skeletons(tmp_path / "process" / "skeletons.json.gz").frames[4:]:
        truth = captures.people(1e-9 * frame.stamp_ns)
        gaps = np.linalg.norm(frame.positions[:, None] - truth[None], axis=-1).max(-1)
        assert gaps.min(axis=0).max() < 5e-3


def test_a_repaired_rig_gives_the_same_bytes_in_one_process_and_in_the_graph(tmp_path):
    first, second, *rest = captures.RIG.cameras
    cameras = (first, turned(second, (0.4, 0.3, 0.0)), *rest)
    sets = [item.detections for item in walk(28.0, ((14.0, cameras),)) if isinstance(item, AssociationSet)]
    views = [replace(view, stamp_ns=view.stamp_ns + 10**9) for item in sets for view in item.views]
    bag = write_bag(tmp_path / "bag", views)
    for out, more in (("dds", []), ("process", ["--in-process"])):
        words = ["run", "--bag", str(bag), "--out", str(tmp_path / out), "--no-pictures", "--repair", *more]
        assert main(words) == 0
    assert skeletons(tmp_path / "dds") == skeletons(tmp_path / "process")
    rigs = [(tmp_path / out / "rig_repaired.json").read_bytes() for out in ("dds", "process")]
    assert rigs[0] == rigs[1]


def test_the_covariance_of_a_calibration_reaches_one_process_and_the_graph(tmp_path):
    """Joint covariances contain the calibration's, and have the same bytes with and without ROS."""
    root = np.diag([*3 * (6e-4,), *3 * (2e-3,), *4 * (0.8,), *5 * (1e-3,)])  # rad, m, px, distortion
    root[3:6, :3] = 1e-3  # translations follow rotations
    doubtful = Rig(tuple(replace(one, covariance=root @ root.T) for one in captures.RIG.cameras))
    views = [replace(view, stamp_ns=view.stamp_ns + 10**9) for view in captures.views(12)]
    found, more = {}, {"dds": [], "process": ["--in-process"], "plain": ["--in-process"]}
    for out, words in more.items():
        bag = write_bag(tmp_path / f"bag_{out}", views, captures.RIG if out == "plain" else doubtful)
        run = ["run", "--bag", str(bag), "--out", str(tmp_path / out), "--no-pictures", *words]
        assert main(run) == 0
        with BagReader(tmp_path / out / "bag") as bag_of_run:
            messages = [message for _, _, message in bag_of_run.messages("/skeletons")]
            found[out] = [from_message(message, "RefinedPoseSet") for message in messages]
    assert skeletons(tmp_path / "dds") == skeletons(tmp_path / "process")
    for graph, own, plain in zip(*found.values(), strict=True):
        assert graph.covariances.tobytes() == own.covariances.tobytes()
        assert np.array_equal(own.positions, plain.positions)
        added = np.trace(own.covariances - plain.covariances, axis1=-2, axis2=-1)
        assert np.median(added) > (2e-3) ** 2  # m^2


def test_people_are_right_and_nothing_is_lost(over_dds):
    result = read_skeletons(over_dds / "skeletons.json.gz")
    assert len(result.frames) == 40
    assert {tuple(sorted(frame.ids.tolist())) for frame in result.frames} == {(0, 1)}
    for frame in result.frames:
        truth = captures.people(frame.stamp_ns * 1e-9)
        gaps = np.linalg.norm(frame.positions[:, None] - truth[None], axis=-1).mean(-1)
        assert gaps.min(axis=1).max() < 0.01
    report = json.loads((over_dds / "report.json").read_text())
    assert report["frames"]["dropped"] == {}
    assert report["frames"]["in"] == {name: 40 for name in captures.RIG.names}


def test_bag_of_the_run_can_be_run_again(over_dds, tmp_path):
    out = tmp_path / "again"
    arguments = ["run", "--bag", str(over_dds / "bag"), "--out", str(out), "--no-pictures", "--in-process"]
    assert main(arguments) == 0
    assert gzip.decompress(skeletons(out)) == gzip.decompress(skeletons(over_dds))


def test_limits_occluders_and_odd_names_reach_every_stage_without_one_camera(tmp_path):
    """A wall, a limit, names that ROS does not allow: the same bytes with and without ROS.

    One camera has no data and is left out; a graph that waited for it would wait for ever.
    """
    names = dict(zip(captures.RIG.names, ("00_12", "left cam", "right-cam", "ü")))
    near = VisibilityLimit(np.full((3, 4), 2500, np.uint16))
    away = captures.RIG.cameras[0].centre * (0.7, 0.7, 0.0) + (0.0, 0.0, 1.0)
    rig = Rig(tuple(replace(camera, name=names[camera.name]) for camera in captures.RIG.cameras))
    rig = replace(rig, occluders=Occluders.box((1.5, 1.5, 2.0), np.eye(3), away))
    views = [
        replace(view, camera=names[view.camera], limit=near if view.camera == "cam1" else None)
        for view in captures.views(12)
        if view.camera != "cam2"
    ]
    bag = write_bag(tmp_path / "bag", views, rig)
    for out, more in (("dds", []), ("process", ["--in-process"])):
        assert main(["run", "--bag", str(bag), "--out", str(tmp_path / out), "--no-pictures", *more]) == 0
        report = json.loads((tmp_path / out / "report.json").read_text())
        assert report["frames"]["in"] == dict.fromkeys(("00_12", "left cam", "ü"), 12)
    assert skeletons(tmp_path / "dds") == skeletons(tmp_path / "process")
    with BagReader(tmp_path / "dds" / "bag") as result:
        assert result.counts["/camera_00_12/detections"] == 12
        back = [from_message(m, "ViewDetections") for _, _, m in result.messages("/left_cam/detections")]
        again = from_message(next(result.messages("/rig"))[2], "Rig")
    assert len(back) == 12 and all(np.array_equal(view.limit.cells, near.cells) for view in back)
    assert np.array_equal(again.occluders.vertices, rig.occluders.vertices)


def test_bag_holds_what_a_subscriber_would_have_seen(over_dds):
    result = read_skeletons(over_dds / "skeletons.json.gz")
    with BagReader(over_dds / "bag") as bag:
        assert bag.counts["/skeletons"] == 40 and bag.counts["/skeletons/markers"] == 40
        messages = [message for _, _, message in bag.messages("/skeletons")]
    for frame, message in zip(result.frames, messages):
        poses = from_message(message, "RefinedPoseSet")
        assert np.array_equal(poses.positions, frame.positions, equal_nan=True)


def test_no_process_and_no_partial_folder_is_left(over_dds):
    assert [path.name for path in over_dds.parent.iterdir()] == ["out"]
