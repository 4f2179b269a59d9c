"""`panoptic calibrate`: from images of a board to a rig with its report, and boards to print."""

import json
import re
import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest

from panoptic_ros.calibration.boards import parse_board
from panoptic_ros.calibration.wands import parse_wand
from panoptic_ros.cli.main import main
from panoptic_ros.domain import Rig, ViewFrame
from panoptic_ros.geometry import Rigid
from panoptic_ros.geometry.rotations import rotations_of
from panoptic_ros.io.bags import BagWriter
from panoptic_ros.io.clock_files import read_clocks
from panoptic_ros.io.messages import bag_messages, to_message
from panoptic_ros.io.messages.images import compressed_image_message, image_message
from panoptic_ros.io.rigs import read_rig, write_rig
from test.support.board_images import artwork, board_poses, photograph, small_rig, write_session

BOARD = "charuco:5x4:60mm"
IMAGES = 24


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    folder = tmp_path_factory.mktemp("session")
    rig = write_session(folder, parse_board(BOARD), board_poses(IMAGES))
    return folder, rig


def distances(rig):
    centres = np.stack([camera.cam_from_world.inverse().translation for camera in rig.cameras])
    return np.linalg.norm(centres[:, None] - centres[None], axis=2)


def test_images_of_a_board_give_a_rig_with_its_report(session, tmp_path, capsys):
    folder, truth = session
    assert (
        main(["calibrate", str(folder), "--board", BOARD, "--synchronous", "--out", str(tmp_path / "o")]) == 0
    )
    out, err = capsys.readouterr()
    assert "predicted error where the target was shown" in out and "Traceback" not in err
    found = read_rig(tmp_path / "o" / "rig.json")
    assert found.names == truth.names and all(camera.covariance is not None for camera in found.cameras)
    np.testing.assert_allclose(distances(found), distances(truth), atol=0.012)
    for own, true in zip(found.cameras, truth.cameras):
        assert own.intrinsics.matrix[0, 0] == pytest.approx(true.intrinsics.matrix[0, 0], rel=0.015)
    page = (tmp_path / "o" / "report.html").read_text()
    assert all(name in page and (tmp_path / "o" / f"{name}.png").exists() for name in truth.names)
    assert not (tmp_path / "o" / "clocks.json").exists()  # no clock is estimated with --synchronous


def test_images_that_are_left_out_are_listed_with_their_reasons(session, tmp_path):
    """List an empty image, a covered board, two boards, and the image of another instant."""
    copied = tmp_path / "s"
    shutil.copytree(session[0], copied)
    files = sorted((copied / "cam1").iterdir())
    images = [cv2.imread(str(file), 0) for file in files]
    board, printed = parse_board(BOARD), artwork(parse_board(BOARD))
    part = np.full_like(printed, 255)
    inner = slice(160, 400), slice(160, 400)  # 2 x 2 squares of 120 px, behind a margin of 40 px
    part[inner] = printed[inner]
    covered = photograph(session[1].camera("cam1"), board, board_poses(IMAGES)[2], part)
    small = cv2.resize(images[3], (320, 240), interpolation=cv2.INTER_AREA)
    wrong = {
        "0001.png": (np.full_like(covered, 128), "the board is not found"),
        "0002.png": (covered, "fewer than 4 corners"),
        "0003.png": (np.pad(np.hstack([small, small]), ((120, 120), (0, 0))), "two boards with the same"),
        "0004.png": (images[9], "most of its corners contradict the other images"),
    }
    for name, (image, _) in wrong.items():
        cv2.imwrite(str(copied / "cam1" / name), image)
    options = ["--board", BOARD, "--synchronous", "--out", str(tmp_path / "o")]
    assert main(["calibrate", str(copied), *options]) == 0
    page = (tmp_path / "o" / "report.html").read_text()
    rows = re.findall(r"<tr><td>cam1</td><td>([^<]+)</td><td>(\d+)</td><td>([^<]+)</td></tr>", page)
    reasons = {file: why for why, _, listed in rows for file in listed.split(", ")}
    assert all(reasons[file].startswith(why) for file, (_, why) in wrong.items())
    assert sum(int(count) for _, count, _ in rows) == len(reasons) < IMAGES / 3


def bag_of(path, folder, topic, kind, damaged=0):
    """Write the images of a folder to a bag, at 10 Hz."""
    with BagWriter(path) as bag:
        for camera in sorted(place for place in folder.iterdir() if place.is_dir()):
            for n, file in enumerate(sorted(camera.iterdir())):
                frame = ViewFrame(camera.name, 10**9 + n * 10**8, n, cv2.imread(str(file)))
                if kind == "raw":
                    message = image_message(frame, bag_messages())
                else:
                    message = compressed_image_message(frame, bag_messages(), 95)
                    if n < damaged:
                        message.data = message.data[:40]
                bag.write(topic.format(camera.name), frame.stamp_ns, message)
    return path


@pytest.mark.parametrize(
    "topic, kind", [("/{}/color/image_raw", "raw"), ("/lab/{}/image_raw/compressed", "compressed")]
)
def test_images_in_a_bag_give_the_rig_of_the_folder(session, tmp_path, capsys, topic, kind):
    folder, truth = session
    bag = bag_of(tmp_path / "bag", folder, topic, kind, damaged=2)
    options = ["--board", BOARD, "--synchronous", "--out", str(tmp_path / "o")]
    assert main(["calibrate", str(bag), *options]) == 0
    found = read_rig(tmp_path / "o" / "rig.json")
    assert found.names == truth.names
    np.testing.assert_allclose(distances(found), distances(truth), atol=0.02)
    damaged = "camera cam0: 2 messages without a usable image were left out" in capsys.readouterr().err
    assert damaged == (kind == "compressed")


def test_a_bag_without_images_is_named(tmp_path, capsys):
    with BagWriter(tmp_path / "bag") as bag:
        bag.write("/rig", 0, to_message(small_rig(), bag_messages()))
    said = refused(capsys, tmp_path / "bag", "--board", BOARD, "--out", tmp_path / "o")
    assert "has no images; there are /rig" in said


def test_clocks_of_cameras_are_written(tmp_path, capsys):
    along = np.linspace(0.0, 1.0, 40)
    turns = rotations_of(
        np.stack([0.7 * np.sin(9 * along), 0.7 * np.cos(7 * along), 0.4 * np.sin(5 * along)], 1)
    )
    places = np.stack([0.3 * np.sin(8 * along), 0.2 * np.cos(6 * along), 1.4 + 0.3 * np.sin(5 * along)], 1)
    moving = [Rigid(turn, place) for turn, place in zip(turns, places)]
    rig = write_session(tmp_path / "s", parse_board(BOARD), moving, small_rig(2))
    rows = [
        f"{c.name},{n},{int(1e9 + n * 1e8 + k * 3e7)}" for k, c in enumerate(rig.cameras) for n in range(40)
    ]
    (tmp_path / "s" / "timestamps.csv").write_text("\n".join(["camera,frame,stamp_ns", *rows]) + "\n")
    assert main(["calibrate", str(tmp_path / "s"), "--board", BOARD, "--out", str(tmp_path / "o")]) == 0
    clocks = read_clocks(tmp_path / "o" / "clocks.json")
    assert clocks["cam1"].offset_s - clocks["cam0"].offset_s == pytest.approx(-0.03, abs=0.01)


def test_the_floor_is_where_the_board_lies(session, tmp_path):
    folder, truth = session
    options = ["--board", BOARD, "--synchronous", "--floor", "0", "--quiet"]
    assert main(["calibrate", str(folder), *options, "--out", str(tmp_path / "o")]) == 0
    found = read_rig(tmp_path / "o" / "rig.json")
    pose = board_poses(IMAGES)[0]  # the first image is that of the floor
    for own, true in zip(found.cameras, truth.cameras):
        height = pose.inverse().apply(true.cam_from_world.inverse().translation)[2]
        assert own.cam_from_world.inverse().translation[2] == pytest.approx(abs(height), abs=0.03)


def test_known_intrinsics_are_kept(session, tmp_path):
    folder, truth = session
    exact = np.diag([1.0] * 6 + [0.1**2] * 4 + [1e-4**2] * 5)
    known = Rig(tuple(replace(camera, covariance=exact) for camera in truth.cameras))
    write_rig(tmp_path / "known.json", known)
    options = ["--board", BOARD, "--synchronous", "--intrinsics", str(tmp_path / "known.json"), "--quiet"]
    assert main(["calibrate", str(folder), *options, "--out", str(tmp_path / "o")]) == 0
    found = read_rig(tmp_path / "o" / "rig.json")
    np.testing.assert_allclose(distances(found), distances(truth), atol=0.002)


def test_known_intrinsics_need_no_poses(session, tmp_path):
    folder, truth = session
    cameras = [
        {
            "name": camera.name,
            "image_size": list(camera.image_size),
            "K": camera.intrinsics.matrix.tolist(),
            "distortion": [0.0] * 5,
        }
        for camera in truth.cameras
    ]
    (tmp_path / "lenses.json").write_text(json.dumps({"cameras": cameras}))
    options = ["--board", BOARD, "--synchronous", "--intrinsics", str(tmp_path / "lenses.json"), "--quiet"]
    assert main(["calibrate", str(folder), *options, "--out", str(tmp_path / "o")]) == 0
    found = read_rig(tmp_path / "o" / "rig.json")
    np.testing.assert_allclose(distances(found), distances(truth), atol=0.01)


def refused(capsys, *words):
    assert main(["calibrate", *map(str, words)]) == 2
    err = capsys.readouterr().err
    assert len(err.strip().splitlines()) == 1, err
    return err


def test_wrong_input_is_named_in_one_line(session, tmp_path, capsys):
    folder, _ = session
    out = tmp_path / "o"
    assert "does not exist" in refused(capsys, tmp_path / "none", "--board", BOARD, "--out", out)
    (tmp_path / "empty").mkdir()
    assert "has no videos" in refused(capsys, tmp_path / "empty", "--board", BOARD, "--out", out)
    assert "is not understood" in refused(capsys, folder, "--board", "charuco", "--out", out)
    said = refused(capsys, folder, "--board", "charuco:8x9:60mm:DICT_7X7_250", "--out", out)
    assert "images shows the board charuco 8x9 with markers DICT_7X7_250; check --board" in said
    said = refused(capsys, folder, "--board", BOARD, "--floor", "9", "--synchronous", "--out", out)
    assert "the board is not seen within 1 s of it" in said
    assert not out.exists()


def test_a_camera_that_never_sees_the_board_is_named(tmp_path, capsys):
    write_session(tmp_path / "s", parse_board(BOARD), board_poses(6), small_rig(2))
    (tmp_path / "s" / "cam7").mkdir()
    cv2.imwrite(str(tmp_path / "s" / "cam7" / "0000.png"), np.full((480, 640), 99, np.uint8))
    assert "camera cam7: no image shows the board" in refused(
        capsys, tmp_path / "s", "--board", BOARD, "--out", tmp_path / "o"
    )


def test_a_board_without_tilt_is_refused(tmp_path, capsys):
    poses = board_poses(12)
    flat = [type(pose)(np.eye(3), pose.translation * [1, 1, 0] + [0, 0, 1.5]) for pose in poses]
    rig = small_rig(2)
    same = [
        type(camera)(camera.name, camera.image_size, camera.intrinsics, rig.cameras[0].cam_from_world)
        for camera in rig.cameras
    ]
    apart = type(rig)((same[0], rig.cameras[1]))
    write_session(tmp_path / "s", parse_board(BOARD), flat, apart)
    code = main(
        ["calibrate", str(tmp_path / "s"), "--board", BOARD, "--synchronous", "--out", str(tmp_path / "o")]
    )
    err = capsys.readouterr().err
    assert code == 2 and "the recording does not determine the cameras" in err and "tilt the board" in err
    assert not (tmp_path / "o").exists()


def test_a_camera_that_mirrors_its_images_is_named(session, tmp_path, capsys):
    folder, _ = session
    copied = tmp_path / "s"
    shutil.copytree(folder, copied)
    for file in (copied / "cam1").iterdir():
        cv2.imwrite(str(file), np.ascontiguousarray(cv2.imread(str(file))[:, ::-1]))
    said = refused(capsys, copied, "--board", BOARD, "--synchronous", "--out", tmp_path / "o")
    assert "camera cam1 (" in said and "views of the board contradict those of other cameras" in said
    assert "does not mirror images" in said and "cam0" not in said and "cam2" not in said
    for name in ("cam0", "cam2"):
        for file in (copied / name).iterdir():
            cv2.imwrite(str(file), np.ascontiguousarray(cv2.imread(str(file))[:, ::-1]))
    said = refused(capsys, copied, "--board", BOARD, "--synchronous", "--out", tmp_path / "o")
    assert "all images show the board mirrored" in said and not (tmp_path / "o").exists()


def test_a_stretched_print_is_refused_or_reported(tmp_path, capsys):
    poses = board_poses(2 * IMAGES)
    for stretch, folder in ((0.01, "bad"), (0.0, "good")):
        scale = (1.0 - 0.5 * stretch, 1.0 + 0.5 * stretch)
        write_session(tmp_path / folder, parse_board(BOARD), poses, small_rig(2), scale)
    options = ["--board", BOARD, "--synchronous", "--out"]
    said = refused(capsys, tmp_path / "bad", *options, tmp_path / "o")
    assert "too high" in said and "print it again at 100 %" in said
    assert main(["calibrate", str(tmp_path / "good"), *options, str(tmp_path / "o")]) == 0
    assert "the print" not in capsys.readouterr().err


def test_two_identical_boards_are_refused(tmp_path, capsys):
    board, rig = parse_board(BOARD), small_rig(2)
    near = [Rigid(pose.rotation, pose.translation + [-0.3, 0.0, 0.9]) for pose in board_poses(8)]
    far = [Rigid(pose.rotation, pose.translation + [0.3, 0.0, 0.9]) for pose in board_poses(8, 1)]
    write_session(tmp_path / "s", board, near, rig)
    printed = artwork(board)
    for camera in rig.cameras:
        for n, pose in enumerate(far):
            file = str(tmp_path / "s" / camera.name / f"{n:04d}.png")
            image, own = cv2.imread(file, 0), photograph(camera, board, pose, printed)
            cv2.imwrite(file, np.where(own == 128, image, own))
    said = refused(capsys, tmp_path / "s", "--board", BOARD, "--out", tmp_path / "o")
    assert "images show two boards with the same markers; cover one" in said


def test_images_of_another_size_are_named(session, tmp_path, capsys):
    folder, truth = session
    copied = tmp_path / "s"
    shutil.copytree(folder, copied)
    file = sorted((copied / "cam1").iterdir())[3]
    cv2.imwrite(str(file), np.zeros((240, 320), np.uint8))
    said = refused(capsys, copied, "--board", BOARD, "--synchronous", "--out", tmp_path / "o")
    assert "cam1" in said and "320" in said and "640" in said
    small = Rig(tuple(replace(camera, image_size=(1280, 960)) for camera in truth.cameras))
    write_rig(tmp_path / "known.json", small)
    options = ["--board", BOARD, "--intrinsics", tmp_path / "known.json", "--out", tmp_path / "o"]
    assert "give intrinsics for this size" in refused(capsys, folder, *options)


def test_a_depth_sensor_gets_its_pose_and_its_unit(session, tmp_path, capsys):
    folder, truth = session
    copied = tmp_path / "s"
    shutil.copytree(folder, copied)
    sensor, depths = truth.cameras[1], copied / "cam1_depth"
    depths.mkdir()
    rows, columns = np.mgrid[:480, :640]
    rays = np.column_stack(
        [sensor.intrinsics.undistort(np.column_stack([columns.ravel(), rows.ravel()])), np.ones(640 * 480)]
    )
    for n, pose in enumerate(board_poses(IMAGES)):
        both = sensor.cam_from_world.compose(pose)
        depth = (both.rotation[:, 2] @ both.translation) / (rays @ both.rotation[:, 2])
        counts = np.clip(depth.reshape(480, 640) / 1.03 * 1000.0, 0, 60000).astype(np.uint16)
        cv2.imwrite(str(depths / f"{n:04d}.png"), counts)
    options = ["--board", BOARD, "--synchronous", "--out", str(tmp_path / "o")]
    assert "no camera cam9" in refused(capsys, copied, *options, "--depth-sensor", "cam1=cam9")
    assert "write INFRARED=COLOUR" in refused(capsys, copied, *options, "--depth-sensor", "cam1")
    assert main(["calibrate", str(copied), *options, "--depth-sensor", "cam1=cam0"]) == 0
    assert "too short; rig.json corrects its unit" in " ".join(capsys.readouterr().err.split())
    found = read_rig(tmp_path / "o" / "rig.json")
    (own,) = found.depth_sensors
    assert found.names == ("cam0", "cam2") and own.colour_camera == "cam0"
    assert own.unit_m == pytest.approx(1.03e-3, rel=0.015)
    apart = np.linalg.norm(own.camera.centre - found.camera("cam0").centre)
    assert apart == pytest.approx(distances(truth)[0, 1], abs=0.012)


def test_a_wand_refines_known_lenses_and_gives_the_rig(tmp_path, capsys):
    rig, wand = small_rig(2), parse_wand("wand:0/100/300mm")
    rng = np.random.default_rng(0)
    for camera in rig.cameras:
        (tmp_path / "s" / camera.name).mkdir(parents=True)
    for n in range(60):
        turn = rotations_of(rng.uniform(-1.2, 1.2, (1, 3)))[0]
        pose = Rigid(turn, rng.uniform([-0.4, -0.3, 1.2], [0.2, 0.2, 1.9]))
        for camera in rig.cameras:
            image = np.full((480, 640), 30, np.uint8)
            for x, y in camera.project(pose.apply(wand.points))[0]:
                place = (round(16 * x), round(16 * y))
                cv2.circle(image, place, 16 * 3, 255, -1, cv2.LINE_AA, 4)
            cv2.imwrite(str(tmp_path / "s" / camera.name / f"{n:04d}.png"), image)
    write_rig(tmp_path / "known.json", rig)
    options = ["--board", "wand:0/100/300mm", "--synchronous", "--out", str(tmp_path / "o")]
    assert "a wand needs known lenses" in refused(capsys, tmp_path / "s", *options)
    known = ["--intrinsics", str(tmp_path / "known.json")]
    assert "for boards" in refused(capsys, tmp_path / "s", *options, *known, "--floor", "1")
    assert "for boards" in refused(capsys, tmp_path / "s", *options, *known, "--depth-sensor", "cam0=cam1")
    assert main(["calibrate", str(tmp_path / "s"), *options, *known]) == 0
    assert "mark points on the floor" in capsys.readouterr().err
    np.testing.assert_allclose(distances(read_rig(tmp_path / "o" / "rig.json")), distances(rig), atol=0.01)


def test_a_board_is_printed_to_scale(tmp_path, capsys):
    assert main(["calibrate", "print", "board", "--board", BOARD, "--out", str(tmp_path / "b.pdf")]) == 0
    assert "on a3 paper" in capsys.readouterr().out
    assert (tmp_path / "b.pdf").read_bytes().startswith(b"%PDF")
    assert "written as .pdf" in refused(capsys, "print", "board", "--out", tmp_path / "b.png")
    assert "does not fit paper a4" in refused(
        capsys, "print", "board", "--board", BOARD, "--paper", "a4", "--out", tmp_path / "c.pdf"
    )
    assert "unknown paper b5" in refused(
        capsys, "print", "board", "--paper", "b5", "--out", tmp_path / "c.pdf"
    )
    assert "prints a board" in refused(capsys, "print", "--out", tmp_path / "c.pdf")


def test_board_files_of_other_programs_are_read(session, tmp_path):
    folder, _ = session
    (tmp_path / "charuco.toml").write_text(
        'columns = 5\nrows = 4\ndictionary = "DICT_4X4_50"\n'
        "aruco_scale = 0.75\nsquare_size_override_cm = 6.0\n"
    )
    options = ["--board", str(tmp_path / "charuco.toml"), "--synchronous", "--quiet"]
    assert main(["calibrate", str(folder), *options, "--out", str(tmp_path / "o")]) == 0
    assert json.loads((tmp_path / "o" / "rig.json").read_text())["cameras"]


def test_a_measured_distance_checks_the_size_of_the_board(session, tmp_path, capsys):
    folder, truth = session
    a, b = truth.names[:2]
    metres = distances(truth)[0, 1]
    options = [str(folder), "--synchronous", "--quiet", "--out", str(tmp_path / "o")]
    right = ["calibrate", *options, "--board", BOARD, "--distance", f"{a},{b}={metres}"]
    assert main(right) == 0
    assert "times as large" not in capsys.readouterr().err
    wrong = ["calibrate", *options, "--board", "charuco:5x4:66mm", "--distance", f"{a},{b}={metres}"]
    assert main(wrong) == 0
    lines = [line for line in capsys.readouterr().err.splitlines() if "times as large" in line]
    assert len(lines) == 1 and "0.9" in lines[0] and "squares" in lines[0]


def test_a_measured_distance_of_unknown_cameras_is_refused(session, tmp_path, capsys):
    said = refused(capsys, session[0], "--board", BOARD, "--distance", "cam0,no=2", "--out", tmp_path / "o")
    assert "no camera 'no'" in said
