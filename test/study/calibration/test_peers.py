"""Calibrations by other libraries: what they receive, how their cameras are scored, how failures show."""

import csv
import sys
from textwrap import dedent

import numpy as np
import pytest
from study_runs import run_named

from panoptic_ros.calibration.boards import Board
from panoptic_ros.calibration.rig_start import CameraInput
from panoptic_ros.calibration.target_views import TargetView
from panoptic_ros.cli.main import main
from panoptic_ros.geometry import Rigid
from panoptic_ros.geometry.rotations import rotations_of
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.simulation.board_sessions import BoardScene, simulate_board
from panoptic_ros.simulation.people_sessions import PeopleScene, simulate_people
from panoptic_ros.simulation.rigs import Ring
from panoptic_ros.study.calibration import peer_child, peers
from panoptic_ros.study.calibration.boards import BOARD, CASES, BoardCase, camera_errors
from panoptic_ros.study.calibration.peers import Problem, attempts, attempts_from_people

# The world of a library is turned and moved against that of the truth.
ELSEWHERE = Rigid(rotations_of(np.array([[0.3, -0.2, 0.5]]))[0], np.array([0.4, -1.0, 2.0]))
LENSES = {"matrices": lambda c: c.intrinsics.matrix, "distortions": lambda c: c.intrinsics.distortion}


def library(monkeypatch, tmp_path, code):
    """Put a script in the place of the child that calls libraries."""
    script = tmp_path / "child.py"
    script.write_text("import shutil, sys, time\n" + dedent(code))
    monkeypatch.setattr(peer_child, "__file__", str(script))


def library_of_truth(monkeypatch, tmp_path, rig):
    """Put a library in that place that knows the true cameras."""
    poses = [camera.cam_from_world.compose(ELSEWHERE) for camera in rig.cameras]
    np.savez(
        tmp_path / "truth.npz",
        **{name: np.stack([value(camera) for camera in rig.cameras]) for name, value in LENSES.items()},
        rotations=np.stack([pose.rotation for pose in poses]),
        translations=np.stack([pose.translation for pose in poses]),
        seconds=1.5,
        note="a remark",
    )
    library(monkeypatch, tmp_path, f"shutil.copy({str(tmp_path / 'truth.npz')!r}, sys.argv[3])")


def problem_of(session, board=BOARD, given=False):
    cameras = session.rig.cameras
    return Problem(
        [CameraInput(camera.name, camera.image_size) for camera in cameras],
        [TargetView(*view) for view in session.views],
        board,
        [camera.intrinsics for camera in cameras] if given else None,
    )


def test_the_cameras_of_a_library_are_scored_in_the_frame_of_the_first_camera(monkeypatch, tmp_path):
    session = simulate_board(BoardScene(3, 4), BOARD.points, 0)
    library_of_truth(monkeypatch, tmp_path, session.rig)
    found = list(attempts(problem_of(session), sys.executable))
    assert [one.program for one in found] == ["caliscope", "aniposelib"]
    for one in found:
        assert (one.solve_s, one.note) == (1.5, "a remark")
        assert one.rig.cameras[0].cam_from_world.rotation == pytest.approx(np.eye(3))
        points = session.rig.cameras[0].cam_from_world.apply(np.random.default_rng(0).uniform(-1, 1, (40, 3)))
        assert max(camera_errors(one.rig, session.rig, points).values()) < 1e-6


@pytest.mark.parametrize(
    ("code", "reason"),
    [
        ("sys.exit('ValueError: no pose')", "caliscope failed: ValueError: no pose"),
        ("time.sleep(30)", "caliscope takes more than 0.5 s"),
        ("", "cannot read answer of caliscope: No such file or directory"),
        ("open(sys.argv[3], 'w').write('{}')", "answer of caliscope"),
    ],
)
def test_a_library_that_fails_gives_the_reason(monkeypatch, tmp_path, code, reason):
    library(monkeypatch, tmp_path, code)
    if "sleep" in code:
        monkeypatch.setattr(peers, "LONGEST_S", 0.5)
    session = simulate_board(BoardScene(2, 3), BOARD.points, 0)
    first = next(attempts(problem_of(session), sys.executable))
    assert first.rig is None and first.solve_s is None
    assert first.note.startswith(reason) and "\n" not in first.note


def test_a_library_that_is_not_installed_is_named(monkeypatch, tmp_path):
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    for name in peer_child.BOARD:
        (tmp_path / f"{name}.py").write_text(f"raise ModuleNotFoundError('no {name}')")
    session = simulate_board(BoardScene(2, 3), BOARD.points, 0)
    for one in attempts(problem_of(session), sys.executable):
        assert one.note == f"{one.program} failed: not installed: no {one.program}"


STUBS = {
    "pandas.py": """
        def DataFrame(rows, columns):
            return [dict(zip(columns, row)) for row in rows]
    """,
    "caliscope/api.py": """
        from types import SimpleNamespace as Chessboard, SimpleNamespace as CameraData
        import numpy as np
        def ImagePoints(rows):
            return rows
        def CameraArray(cameras):
            return cameras
        class ConstraintSet:
            @staticmethod
            def from_chessboard(board):
                assert (board.columns, board.rows) == (3, 4) and abs(board.square_size_cm - 5.4) < 1e-9
        def calibrate_intrinsics(rows, camera):
            lens = {"matrix": 7.0 * np.eye(3), "distortions": np.ones(5)}
            return Chessboard(camera=CameraData(**vars(camera), **lens))
        def calibrate_extrinsics(rows, cameras, constraints):
            for k, camera in cameras.items():
                own = [row for row in rows if row["cam_id"] == k]
                assert own and camera.cam_id == k and camera.size == (1280, 720) and not camera.fisheye
                assert all(abs(row["obj_loc_x"] - 0.054 * (row["keypoint_id"] % 3)) < 1e-9 for row in own)
                assert all(abs(row["obj_loc_y"] - 0.054 * (row["keypoint_id"] // 3)) < 1e-9 for row in own)
                camera.rotation = np.eye(3)
                camera.translation = np.array([len(own), sum(row["img_loc_x"] for row in own), k])
            return Chessboard(
                capture_volume=Chessboard(camera_array=Chessboard(posed_cameras=cameras)),
                intrinsic_refinement_gated=True,
            )
    """,
    "aniposelib/__init__.py": "",
    "aniposelib/boards.py": """
        class CharucoBoard:
            def __init__(self, columns, rows, square, marker):
                assert (columns, rows) == (4, 5) and abs(square - 0.054) < 1e-9 and 0.0 < marker < square
            def fill_points_rows(self, rows):
                for row in rows:
                    row["filled"] = True
    """,
    "aniposelib/cameras.py": """
        import numpy as np
        class Camera:
            def __init__(self, size, name):
                assert size == (1280, 720)
                self.matrix, self.terms = 7.0 * np.eye(3), np.ones(5)
            def set_camera_matrix(self, matrix):
                self.matrix = matrix
            def set_distortions(self, terms):
                self.terms = terms
            get_camera_matrix = lambda self: self.matrix
            get_distortions = lambda self: self.terms
            get_rotation = lambda self: np.zeros(3)
            get_translation = lambda self: self.translation
        class CameraGroup:
            def __init__(self, cameras):
                self.cameras = cameras
            def calibrate_rows(self, rows, board, init_intrinsics, only_extrinsics, verbose):
                assert only_extrinsics != init_intrinsics
                for k, (camera, own) in enumerate(zip(self.cameras, rows)):
                    assert all(row["filled"] and len(row["ids"]) == len(row["corners"]) for row in own)
                    assert len({row["framenum"] for row in own}) == len(own)
                    count = sum(row["ids"].size for row in own)
                    total = sum(row["corners"][..., 0].sum() for row in own)
                    camera.translation = np.array([count, total, k])
                print("a library that prints")
    """,
}


@pytest.mark.parametrize("given", [True, False])
def test_libraries_receive_every_corner_the_board_and_known_lenses(monkeypatch, tmp_path, given):
    for name, text in STUBS.items():
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(dedent(text))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr("panoptic_ros.domain.camera.FARTHEST", 1e9)  # the stubs return sums of pixels as t
    board = Board("charuco", 4, 5, 0.054, 0.04, "DICT_4X4_50")
    session = simulate_board(BoardScene(3, 6), board.points, 0)
    sums = np.array(
        [
            [sum(len(own) for own in pixels), sum(own[:, 0].sum() for own in pixels), k]
            for k in range(3)
            for pixels in [[view.pixels for view in session.views if view.camera == k]]
        ]
    )
    for one in attempts(problem_of(session, board, given), sys.executable):
        assert one.note == ("intrinsics not refined" if one.program == "caliscope" else ""), one
        for k, camera in enumerate(one.rig.cameras):
            assert camera.cam_from_world.translation == pytest.approx(sums[k] - sums[0])
            true = session.rig.cameras[k].intrinsics
            assert camera.intrinsics.matrix[0, 0] == (true.matrix[0, 0] if given else 7.0)
            assert camera.intrinsics.distortion == pytest.approx(true.distortion if given else np.ones(5))


PEOPLE_STUBS = {
    "pandas.py": """
        def DataFrame(columns):
            return columns
    """,
    "caliscope/api.py": """
        from types import SimpleNamespace as CameraData
        import numpy as np
        def ImagePoints(table):
            return table
        def CameraArray(cameras):
            return cameras
        def calibrate_extrinsics(table, cameras, constraints, refine_intrinsics):
            assert constraints is None and not refine_intrinsics and np.isnan(table["obj_loc_x"])
            for k, camera in cameras.items():
                own = table["cam_id"] == k
                keys = [table[name][own] for name in ("sync_index", "object_id", "keypoint_id")]
                assert len(np.unique(keys, axis=1)[0]) == own.sum()
                camera.rotation = np.eye(3)
                camera.translation = np.array([own.sum(), table["img_loc_x"][own].sum(), k])
            posed = CameraData(posed_cameras=cameras)
            return CameraData(capture_volume=CameraData(camera_array=posed))
    """,
}


def test_a_library_for_people_receives_every_true_joint_and_known_lenses(monkeypatch, tmp_path):
    for name, text in PEOPLE_STUBS.items():
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(dedent(text))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr("panoptic_ros.domain.camera.FARTHEST", 1e9)  # the stubs return sums of pixels as t
    session = simulate_people(PeopleScene(Ring(3), seconds=0.2), 0)
    joints = session.joints
    sums = np.array(
        [[own.sum(), joints.pixels[own, 0].sum(), k] for k in range(3) for own in [joints.camera == k]]
    )
    (found,) = attempts_from_people(session.rig, joints, sys.executable)
    assert found.program == "caliscope" and found.note == ""
    for k, camera in enumerate(found.rig.cameras):
        assert camera.cam_from_world.translation == pytest.approx(sums[k] - sums[0])
        assert camera.intrinsics.matrix == pytest.approx(session.rig.cameras[k].intrinsics.matrix)


def test_the_study_of_people_has_rows_of_all_programs(monkeypatch, tmp_path):
    library(monkeypatch, tmp_path, "sys.exit('no luck')")
    words = f"--cases 4 --seconds 2 --seeds 0 --peers {sys.executable}"
    rows = run_named("calibration-people", words)["rows"]
    assert [(row["program"], row["failed"]) for row in rows] == [("panoptic", 0.0), ("caliscope", 1.0)]


def test_the_study_of_simulated_boards_has_rows_of_all_programs(monkeypatch, tmp_path):
    monkeypatch.setitem(CASES, "4x60", BoardCase(BoardScene(3, 25)))
    library(
        monkeypatch,
        tmp_path,
        "sys.exit('no luck') if sys.argv[1] == 'caliscope' else sys.exit('none either')",
    )
    rows = run_named("calibration", f"--cases 4x60 --seeds 0 --peers {sys.executable}")["rows"]
    assert [(row["program"], row["intrinsics"], row["failed"]) for row in rows] == [
        (program, intrinsics, float(program != "panoptic"))
        for intrinsics in ("unknown", "given")
        for program in ("panoptic", "caliscope", "aniposelib")
    ]
    assert rows[3]["error_m"] < 0.8 * rows[0]["error_m"]  # known lenses help
    assert rows[1]["note"] == "caliscope failed: no luck"


def session_folder(folder, session):
    """Write a session as files: the second half of its instants is left out."""
    folder.mkdir()
    names = session.rig.names
    write_rig(folder / "caliscope_rig.json", session.rig)
    with open(folder / "corners.csv", "w", newline="") as file:
        lines = csv.writer(file)
        lines.writerow(["sync_index", "camera", "frame", "corner", "x", "y", "speed_px_s", "split"])
        for view in session.views:
            for number, (x, y) in zip(view.numbers, view.pixels):
                split = "test" if view.instant % 2 else "train"
                lines.writerow([view.instant, names[view.camera], view.instant, number, x, y, 5.0, split])
    with open(folder / "timestamps.csv", "w", newline="") as file:
        lines = csv.writer(file)
        lines.writerow(["sync_index", "cam_id", "frame_index", "frame_time"])
        last = max(view.instant for view in session.views)
        lines.writerows([n, name, n, 100.0 + n / 6.0] for name in names for n in range(last + 1))
    return folder


def test_the_study_of_sessions_scores_all_programs_alike(monkeypatch, tmp_path):
    board = Board("checkerboard", 5, 4, 0.1)
    session = simulate_board(BoardScene(4, 80, smooth=True), board.points, 1)
    library_of_truth(monkeypatch, tmp_path, session.rig)
    folder = session_folder(tmp_path / "session", session)
    words = f"--session {folder} --board checkerboard:5x4:100mm"
    assert {row["program"] for row in run_named("calibration-sessions", words)["rows"]} == {"panoptic"}
    rows = run_named("calibration-sessions", f"{words} --peers {sys.executable}")["rows"]
    slow = {(row["program"], row["intrinsics"]): row for row in rows if row["corners"] == "slow"}
    assert len(slow) == 6 and len({row["points"] for row in slow.values()}) == 1
    for row in slow.values():
        assert 0.1 < row["residual_px"] < 0.3  # 0.3 px per axis, two to three views of a point
        assert abs(row["scale"]) < 0.002
    assert slow["caliscope", "given"]["distance_m"] <= slow["panoptic", "unknown"]["distance_m"] * 1.05
    assert slow["caliscope", "given"]["solve_s"] == 1.5


def test_wrong_options_end_in_one_line(tmp_path, capsys):
    folder = session_folder(tmp_path / "session", simulate_board(BoardScene(2, 3), BOARD.points, 0))
    assert main(["study", "calibration", "--peers", "/no/python"]) == 2
    assert "'/no/python' is no program; give a Python interpreter" in capsys.readouterr().err
    words = ["study", "calibration-sessions", "--session", str(folder), "--board", "aprilgrid:3x3:50mm"]
    assert main([*words, "--peers", sys.executable]) == 2
    assert "charuco and checkerboard boards; omit --peers" in capsys.readouterr().err
    words = ["study", "calibration-people", "--capture", str(folder), "--peers", sys.executable]
    assert main(words) == 2
    assert "omit --peers or --capture" in capsys.readouterr().err
