"""Plans of runs on running drivers: which messages carry what, and how the images were taken."""

import json
from dataclasses import replace

import captures
import numpy as np
import pytest

pytest.importorskip("rclpy")

from panoptic_ros.domain import DepthSensor
from panoptic_ros.errors import CalibrationError, DataError, UsageError
from panoptic_ros.geometry import Rigid
from panoptic_ros.graph.build import configure
from panoptic_ros.io.messages import bag_messages, camera_info_message
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.nodes.sources.drivers import DriverSearchResult
from panoptic_ros.running.plans import driver_plan
from panoptic_ros.running.runs.launch import write_launch_file

SENSOR = captures.look_at("k1", (0.0, 4.0, 2.0), size=(320, 240))
IMAGE, PACKED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
INFO = "sensor_msgs/msg/CameraInfo"


@pytest.fixture
def plan(tmp_path, monkeypatch):
    """Makes the plan of a text of topics with what drivers are said to publish."""
    write_rig(tmp_path / "rig.json", captures.RIG)
    write_rig(tmp_path / "kinects.json", replace(captures.RIG, depth_sensors=(DepthSensor(SENSOR),)))

    def make(text, types, infos=(), rig="rig.json"):
        (tmp_path / "drivers.yaml").write_text(text)
        monkeypatch.setattr(
            driver_plan, "find_drivers", lambda wanted: DriverSearchResult(types, dict(infos))
        )
        monkeypatch.setattr(driver_plan, "prepare_environment", lambda: None)
        return driver_plan.plan_drivers(tmp_path / "drivers.yaml", rig=tmp_path / rig if rig else None)

    return make


def info_of(name):
    return camera_info_message(captures.RIG.camera(name), 7, bag_messages())


def test_every_message_goes_to_the_detector_by_its_kind(plan, tmp_path):
    made = plan(
        "cam0: {image: /a/image_raw, encoding: bayer_rggb8}\n"
        "cam1: {image: /b/image_raw/compressed, depth: /b/depth/compressedDepth}\n"
        "cam2: {image: /c/image_raw, depth: /c/depth}\n",
        {
            "/a/image_raw": IMAGE,
            "/b/image_raw/compressed": PACKED,
            "/b/depth/compressedDepth": PACKED,
            "/c/image_raw": IMAGE,
            "/c/depth": IMAGE,
        },
    )
    assert made.live and made.rig.names == ("cam0", "cam1", "cam2") and not made.sources
    launch = write_launch_file(made, tmp_path, "live", 64, 0)
    processes = json.loads(launch.read_text())["processes"]
    assert sorted(processes) == ["detection-0", "fusion"]
    given = processes["detection-0"][0]["parameters"]
    assert sorted(given["topics"]) == [
        "compressed_depth cam1=/b/depth/compressedDepth",
        "compressed_image cam1=/b/image_raw/compressed",
        "depth cam2=/c/depth",
        "image cam0=/a/image_raw",
        "image cam2=/c/image_raw",
    ]
    assert given["encodings"] == ["cam0=bayer_rggb8"] and given["inputs.compressed_image"] == ["cam1"]
    assert given["inputs.depth"] == ["cam1", "cam2"] and given["inputs.compressed_depth"] == ["cam1"]


def test_an_encoding_that_compressed_images_do_not_heed_is_told(plan):
    text = "cam0: {image: /a, encoding: rgb8}\ncam1: {image: /b, encoding: ' BAYER_rggb8'}\n"
    (line,) = plan(text, {"/a": PACKED, "/b": PACKED}).notices
    assert "encoding rgb8 of camera cam0 has no meaning" in line


def test_rectified_images_take_their_lens_from_camera_info(plan):
    info = info_of("cam0")
    info.p = np.array([[800.0, 0, 640, 0], [0, 800, 360, 0], [0, 0, 1, 0]]).reshape(12)
    made = plan(
        "cam0: {image: /a/image_rect_color}\ncam1: {image: /b/image_raw}\n",
        {"/a/image_rect_color": IMAGE, "/a/camera_info": INFO, "/b/image_raw": IMAGE},
        {"/a/camera_info": info},
    )
    seen = made.rig.camera("cam0")
    assert seen.intrinsics.matrix[0, 0] == 800 and not seen.intrinsics.distortion.any()
    assert np.allclose(seen.centre, captures.RIG.camera("cam0").centre)
    assert made.rig.camera("cam1").intrinsics is not None and len(made.notices) == 1
    assert "/a/image_rect_color is rectified" in made.notices[0]


def test_another_calibration_is_told_and_another_size_refused(plan):
    text = "cam0: {image: /a/image_raw, camera_info: /a/camera_info}\ncam1: {image: /b/image_raw}\n"
    types = {"/a/image_raw": IMAGE, "/a/camera_info": INFO, "/b/image_raw": IMAGE}
    info = info_of("cam0")
    assert plan(text, types, {"/a/camera_info": info}).notices == ()
    info.k[0] *= 1.05
    assert "its driver states a focal length" in plan(text, types, {"/a/camera_info": info}).notices[0]
    info.width = 640
    with pytest.raises(CalibrationError, match="publishes images of 640 x 720, but the rig"):
        plan(text, types, {"/a/camera_info": info})


def test_what_cannot_be_is_refused(plan):
    types = {"/a/image_raw": "std_msgs/msg/String", "/b/image_raw": IMAGE}
    text = "cam0: {image: /a/image_raw}\ncam1: {image: /b/image_raw}\n"
    with pytest.raises(DataError, match=r"/a/image_raw \(image of camera cam0\) carries std_msgs/msg/String"):
        plan(text, types)
    with pytest.raises(DataError, match="camera cam0 has encoding 'nv22', perhaps nv2"):
        plan("cam0: {image: /a, encoding: nv22}\ncam1: {image: /b}\n", {})
    types["/a/image_raw"] = "foxglove_msgs/msg/CompressedVideo"
    with pytest.raises(DataError, match="image of camera cam0: /a/image_raw is compressed video .*republish"):
        plan(text, types)
    with pytest.raises(CalibrationError, match="nobody"):
        plan("cam0: {image: /a}\nnobody: {image: /b}\n", {})
    with pytest.raises(CalibrationError, match="1 camera"):
        plan("cam0: {image: /a}\n", {})


BOTH = "cam0: {image: /a/image_raw}\ncam1: {image: /b/image_rect}\nk1: {depth: /k/depth/image_raw}\n"
TYPES = {
    "/a/image_raw": IMAGE,
    "/b/image_rect": IMAGE,
    "/k/depth/image_raw": IMAGE,
    "/a/camera_info": INFO,
    "/b/camera_info": INFO,
    "/k/depth/camera_info": INFO,
}


def sensor_info():
    return camera_info_message(SENSOR, 7, bag_messages())


def test_depth_sensors_alone_are_those_of_the_rig(plan, tmp_path):
    infos = {"/b/camera_info": info_of("cam1"), "/k/depth/camera_info": sensor_info()}
    made = plan(BOTH, TYPES, infos, "kinects.json")
    (sensor,) = made.rig.depth_sensors
    assert sensor.name == "k1" and np.allclose(sensor.camera.centre, SENSOR.centre)
    assert made.topics["sensor_depth"] == {"k1": "/k/depth/image_raw"} and not made.depth_cameras
    active = {**made.configs, "patches": configure({"patches": {"active": True}})["patches"]}
    (tmp_path / "launched").mkdir()
    launch = write_launch_file(replace(made, configs=active), tmp_path / "launched", "live", 64, 0)
    nodes = [node for nodes in json.loads(launch.read_text())["processes"].values() for node in nodes]
    (given,) = (node["parameters"] for node in nodes if "patches" in node.get("stages", ()))
    assert given["inputs.sensor_depth"] == ["k1"]
    assert given["topics"] == ["sensor_depth k1=/k/depth/image_raw"]
    infos["/k/depth/camera_info"].width = 640
    with pytest.raises(CalibrationError, match="k1 publishes depth maps of 640 x 240, but the rig"):
        plan(BOTH, TYPES, infos, "kinects.json")
    with pytest.raises(CalibrationError, match="no depth sensor 'k1'; it has none"):
        plan(BOTH, TYPES, infos)


def test_without_a_rig_lenses_are_those_of_camera_info_and_poses_those_of_tf(plan, monkeypatch):
    cameras = {name: captures.RIG.camera(name) for name in ("cam0", "cam1")} | {"k1": SENSOR}
    infos = {
        "/a/camera_info": info_of("cam0"),
        "/b/camera_info": info_of("cam1"),
        "/k/depth/camera_info": sensor_info(),
    }
    asked = []

    def find(frames, fixed):
        asked.append((frames, fixed))
        return "map", {f"{n}_optical_frame": c.cam_from_world.inverse() for n, c in cameras.items()}

    monkeypatch.setattr(driver_plan, "find_transforms", find)
    made = plan("fixed_frame: map\n" + BOTH, TYPES, infos, "")
    assert asked == [(sorted(f"{name}_optical_frame" for name in cameras), "map")]
    assert made.rig.frame_id == "map" and made.rig.names == ("cam0", "cam1")
    point = np.array([[0.3, -0.2, 1.1]])
    for name in ("cam0",):
        seen, wanted = made.rig.camera(name).project(point)[0], cameras[name].project(point)[0]
        np.testing.assert_allclose(seen, wanted, atol=1e-6)
    assert not made.rig.camera("cam1").intrinsics.distortion.any()  # rectified
    np.testing.assert_allclose(made.rig.camera("cam1").centre, cameras["cam1"].centre, atol=1e-9)
    np.testing.assert_allclose(made.rig.depth_sensor("k1").camera.centre, SENSOR.centre, atol=1e-9)

    baseline = infos["/b/camera_info"]
    baseline.p[3] = -0.12 * baseline.p[0]  # the right camera of a pair names the left one's frame
    right = plan("fixed_frame: map\n" + BOTH, TYPES, infos, "").rig.camera("cam1")
    step = cameras["cam1"].cam_from_world.rotation @ (right.centre - cameras["cam1"].centre)
    np.testing.assert_allclose(step, [0.12, 0, 0], atol=1e-9)


def test_drivers_that_are_not_calibrated_are_told(plan, monkeypatch):
    monkeypatch.setattr(
        driver_plan, "find_transforms", lambda frames, fixed: ("map", dict.fromkeys(frames, Rigid.identity()))
    )
    text = "cam0: {image: /a/image_raw}\ncam1: {image: /b/image_raw}\n"
    types = {"/a/image_raw": IMAGE, "/b/image_raw": IMAGE, "/a/camera_info": INFO, "/b/camera_info": INFO}
    infos = {"/a/camera_info": info_of("cam0"), "/b/camera_info": info_of("cam1")}
    infos["/b/camera_info"].k[:] = 0
    with pytest.raises(CalibrationError, match="cam1 is all 0: its driver is not calibrated; calib"):
        plan(text, types, infos, "")
    infos["/a/camera_info"].header.frame_id = ""
    with pytest.raises(CalibrationError, match=r"cam0 \(/a/camera_info\) names no frame"):
        plan(text, types, infos, "")
    with pytest.raises(UsageError, match="--fixed-frame names a frame of TF"):
        plan("fixed_frame: map\n" + text, types, infos)
    with pytest.raises(CalibrationError, match="names 1 camera, which is not enough"):
        plan("cam0: {image: /a/image_raw}", types, infos, "")


def test_the_rig_counts_where_the_driver_is_not_calibrated(plan):
    text = "cam0: {image: /a/image_raw, camera_info: /a/camera_info}\ncam1: {image: /b/image_raw}\n"
    types = {"/a/image_raw": IMAGE, "/a/camera_info": INFO, "/b/image_raw": IMAGE}
    ours = captures.RIG.camera("cam0")
    for change, told in (
        ({"width": 0, "height": 0}, "states images of 0 x 0: its driver is not calibrated"),
        ({"width": 0, "height": 0, "k": np.zeros(9), "d": [], "distortion_model": ""}, "is all 0"),
        ({"d": np.zeros(8)}, "plumb_bob has 5 coefficients, not 8; the others are 0 and mean nothing"),
        ({"d": np.ones(3), "distortion_model": "omni"}, "the distortion model is 'omni'"),
        ({"d": np.ones(6), "distortion_model": "opencv"}, "6 distortion coefficients"),
    ):
        info = info_of("cam0")
        for name, value in change.items():
            setattr(info, name, value)
        made = plan(text, types, {"/a/camera_info": info})
        (line,) = made.notices
        assert told in line and "camera_info of cam0" in line
        assert line.endswith("the rig's calibration is used")
        seen = made.rig.camera("cam0")
        assert seen.image_size == ours.image_size
        assert np.array_equal(seen.intrinsics.distortion, ours.intrinsics.distortion)


def test_binned_and_cut_images_of_a_rig(plan):
    text = "cam0: {image: /a/image_raw, camera_info: /a/camera_info}\ncam1: {image: /b/image_raw}\n"
    types = {"/a/image_raw": IMAGE, "/a/camera_info": INFO, "/b/image_raw": IMAGE}
    info = info_of("cam0")
    info.binning_x = info.binning_y = 2
    made = plan(text, types, {"/a/camera_info": info})
    seen, ours = made.rig.camera("cam0"), captures.RIG.camera("cam0")
    assert seen.image_size == (640, 360) and len(made.notices) == 1
    assert "CameraInfo states that images of 640x360 are binned or cropped from 1280x720" in made.notices[0]
    points = captures.people(0.0)[0]
    assert np.allclose(seen.project(points)[0], (ours.project(points)[0] - 0.5) / 2, atol=1e-9)
    rectified = plan(
        "cam0: {image: /a/image_rect}\ncam1: {image: /b/image_raw}\n",
        {**types, "/a/image_rect": IMAGE},
        {"/a/camera_info": info},
    ).rig.camera("cam0")
    assert rectified.image_size == (640, 360)
    assert np.isclose(rectified.intrinsics.matrix[0, 0], 0.5 * ours.intrinsics.matrix[0, 0])


def test_lenses_of_drivers_without_a_rig_are_read_by_any_name(plan, monkeypatch):
    infos = {f"/{name}/camera_info": info_of(camera) for name, camera in (("a", "cam0"), ("b", "cam1"))}
    infos["/a/camera_info"].distortion_model = "rational_polynomial"
    infos["/a/camera_info"].d = np.array([0.2, -0.1, 0, 0, 0.05, 0.1, -0.05, 0.02])
    infos["/b/camera_info"].d = np.zeros(8)
    monkeypatch.setattr(driver_plan, "find_transforms", lambda frames, fixed: ("world", poses_of(frames)))
    text = "cam0: {image: /a/image_raw}\ncam1: {image: /b/image_raw}\n"
    types = {"/a/image_raw": IMAGE, "/b/image_raw": IMAGE, "/a/camera_info": INFO, "/b/camera_info": INFO}
    made = plan(text, types, infos, rig=None)
    assert len(made.rig.camera("cam0").intrinsics.distortion) == 8
    assert not made.rig.camera("cam1").intrinsics.distortion.any()
    assert any("camera_info of cam1: distortion model plumb_bob has 5" in line for line in made.notices)


def poses_of(frames):
    rig = captures.RIG
    return {
        frame: rig.camera(frame.removesuffix("_optical_frame")).cam_from_world.inverse() for frame in frames
    }
