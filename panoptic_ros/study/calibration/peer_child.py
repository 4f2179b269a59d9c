"""Script that calibrates cameras with another library; it imports nothing of this project.

It runs in any Python interpreter that has the library: python peer_child.py LIBRARY IN.npz OUT.npz
"""

from __future__ import annotations

import contextlib
import importlib
import sys
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

Array = np.ndarray
Cameras = list[tuple[Array, Array, Array, Array]]  # matrix (3, 3), distortion, rotation (3, 3), translation m


def main(library: str, inputs: str, outputs: str) -> None:
    """Calibrate the cameras of IN.npz and write matrices, distortions, poses and the seconds to OUT.npz.

    The library calibrates twice. The second time counts, because aniposelib compiles functions in the first.
    The process exits with code 1 and one line on standard error if the library fails.
    """
    with np.load(inputs) as stored:
        given = dict(stored)
    try:
        with contextlib.redirect_stdout(sys.stderr):
            for _ in range(2):
                np.random.seed(0)  # aniposelib draws samples
                found, seconds, note = (PEOPLE if "people" in given else BOARD)[library](given)
    except ImportError as error:
        sys.exit(f"not installed: {error}")
    except Exception as error:
        sys.exit(f"{type(error).__name__}: {' '.join(str(error).split())}")
    matrices, distortions, rotations, translations = zip(*found)
    np.savez(
        outputs,
        matrices=matrices,
        distortions=distortions,
        rotations=rotations,
        translations=translations,
        seconds=seconds,
        note=note,
    )


def views_of(given: dict[str, Array]) -> Iterator[tuple[int, int, Array, Array]]:
    """Yield camera, instant, point numbers (K,) and pixels (K, 2) of each view."""
    for n, (camera, instant) in enumerate(zip(given["cameras"], given["instants"])):
        own = slice(*given["starts"][n : n + 2])
        yield int(camera), int(instant), given["numbers"][own], given["pixels"][own]


def known_lens(given: dict[str, Array], camera: int) -> tuple[Array, Array]:
    """Return the known matrix (3, 3) and the distortion of a camera; a fisheye has four terms."""
    terms = given["distortions"][camera]
    return given["matrices"][camera].copy(), (terms[:4] if given["fisheye"][camera] else terms).copy()


def by_caliscope(given: dict[str, Array]) -> tuple[Cameras, float, str]:
    """Calibrate by caliscope; unknown intrinsics by its calibration of each camera from the same corners."""
    api = importlib.import_module("caliscope.api")
    frame = importlib.import_module("pandas").DataFrame
    columns, rows = (int(count) for count in given["grid"])
    board = api.Chessboard(rows=rows, columns=columns, square_size_cm=100.0 * float(given["square_m"]))
    constraints = api.ConstraintSet.from_chessboard(board)
    table = [
        (instant, camera, 0, number, *pixel, *given["points"][number])
        for camera, instant, numbers, pixels in views_of(given)
        for number, pixel in zip(numbers, pixels)
    ]
    names = "sync_index cam_id object_id keypoint_id img_loc_x img_loc_y obj_loc_x obj_loc_y obj_loc_z"
    points = api.ImagePoints(frame(table, columns=names.split()))
    cameras = {
        k: api.CameraData(cam_id=k, size=tuple(map(int, size)), fisheye=bool(fisheye))
        for k, (size, fisheye) in enumerate(zip(given["sizes"], given["fisheye"]))
    }
    begin = time.perf_counter()
    for k, camera in cameras.items():
        if "matrices" in given:
            camera.matrix, camera.distortions = known_lens(given, k)
        else:
            cameras[k] = api.calibrate_intrinsics(points, camera).camera
    run = api.calibrate_extrinsics(points, api.CameraArray(cameras), constraints)
    seconds = time.perf_counter() - begin
    return _posed(run, cameras), seconds, "intrinsics not refined" if run.intrinsic_refinement_gated else ""


def by_aniposelib(given: dict[str, Array]) -> tuple[Cameras, float, str]:
    """Calibrate by aniposelib; it estimates unknown intrinsics as one focal length and k1 per camera."""
    library = importlib.import_module("aniposelib.cameras")
    rotation_of = importlib.import_module("cv2").Rodrigues
    columns, rows = (int(count) for count in given["grid"])
    square = float(given["square_m"])
    board = importlib.import_module("aniposelib.boards").CharucoBoard(
        columns + 1, rows + 1, square, 0.75 * square
    )
    known = "matrices" in given
    cameras = [
        (library.FisheyeCamera if fisheye else library.Camera)(size=tuple(map(int, size)), name=str(k))
        for k, (size, fisheye) in enumerate(zip(given["sizes"], given["fisheye"]))
    ]
    detections: list[list[dict[str, Any]]] = [[] for _ in cameras]
    for k, instant, numbers, pixels in views_of(given):
        detections[k].append({"framenum": instant, "corners": pixels[:, None], "ids": numbers[:, None]})
    for k, camera in enumerate(cameras):
        board.fill_points_rows(detections[k])
        if known:
            matrix, distortion = known_lens(given, k)
            camera.set_camera_matrix(matrix)
            camera.set_distortions(distortion)
    group = library.CameraGroup(cameras)
    begin = time.perf_counter()
    group.calibrate_rows(detections, board, init_intrinsics=not known, only_extrinsics=known, verbose=False)
    seconds = time.perf_counter() - begin
    found = [
        (
            own.get_camera_matrix(),
            own.get_distortions(),
            rotation_of(own.get_rotation())[0],
            own.get_translation(),
        )
        for own in group.cameras
    ]
    return found, seconds, ""


def by_caliscope_people(given: dict[str, Array]) -> tuple[Cameras, float, str]:
    """Calibrate by caliscope from joints of people; the intrinsics are known and stay."""
    api = importlib.import_module("caliscope.api")
    frame = importlib.import_module("pandas").DataFrame
    names = ("sync_index", "cam_id", "object_id", "keypoint_id", "img_loc_x", "img_loc_y")
    unknown = dict.fromkeys(("obj_loc_x", "obj_loc_y", "obj_loc_z"), np.nan)
    columns = (*(given[key] for key in ("instants", "cameras", "people", "joints")), *given["pixels"].T)
    points = api.ImagePoints(frame({**dict(zip(names, columns)), **unknown}))
    cameras = {
        k: api.CameraData(cam_id=k, size=tuple(map(int, size))) for k, size in enumerate(given["sizes"])
    }
    for k, camera in cameras.items():
        camera.matrix, camera.distortions = known_lens(given, k)
    begin = time.perf_counter()
    run = api.calibrate_extrinsics(points, api.CameraArray(cameras), None, refine_intrinsics=False)
    return _posed(run, cameras), time.perf_counter() - begin, ""


def _posed(run: Any, cameras: dict[int, Any]) -> Cameras:
    """Return the cameras of a run of caliscope; an error names those without a pose."""
    posed = run.capture_volume.camera_array.posed_cameras
    missing = sorted(set(cameras) - set(posed))
    if missing:
        raise RuntimeError(f"no pose of cameras {missing}")
    return [(own.matrix, own.distortions, own.rotation, own.translation) for _, own in sorted(posed.items())]


BOARD, PEOPLE = {"caliscope": by_caliscope, "aniposelib": by_aniposelib}, {"caliscope": by_caliscope_people}

if __name__ == "__main__":
    main(*sys.argv[1:])
