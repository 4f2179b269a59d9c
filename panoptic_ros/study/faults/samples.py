"""Minimal samples of every format; each function writes one sample and returns its path."""

from __future__ import annotations

import gzip
import importlib
import json
import shutil
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.domain import Camera, Rig, ViewDetections
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.io.bags import BagWriter
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.messages import bag_messages, to_message
from panoptic_ros.io.resources import share_folder
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.io.skeletons import load_skeleton
from panoptic_ros.io.wav import write_wav

Sample = Callable[[Path], Path]
POINT = np.array([0.1, 0.2, 1.0])  # m, in front of all cameras
SIZE = (64, 48)  # image width and height, px
SECOND = 1_000_000_000


@lru_cache(maxsize=1)
def rig() -> Rig:
    """Return a rig of three cameras that look along y."""
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    matrix = np.array([[60.0, 0.0, 31.5], [0.0, 60.0, 23.5], [0.0, 0.0, 1.0]])
    return Rig(
        tuple(
            Camera(name, SIZE, Intrinsics(matrix, np.full(5, 0.01)), Rigid(turn, np.array([x, 1.0, 4.0])))
            for name, x in (("cam00", 0.0), ("cam01", 0.3), ("cam02", 0.6))
        )
    )


def rig_file(form: str, name: str = "rig.json") -> Sample:
    """Return a writer of the rig in one format of `rigs.WRITABLE`."""

    def write(folder: Path) -> Path:
        write_rig(folder / name, rig(), form)
        return folder / name

    return write


def camera_info(name: str) -> Sample:
    """Return a writer of the rig as a folder of YAML files; it returns the path of one file."""

    def write(folder: Path) -> Path:
        write_rig(folder / "infos", rig(), "camera_info")
        return folder / "infos" / name

    return write


def lenses(folder: Path) -> Path:
    """Write the rig as rig.json without poses."""
    path = rig_file("rig.json", "lenses.json")(folder)
    document = json.loads(path.read_text())
    for camera in document["cameras"]:
        del camera["R"], camera["t"]
    path.write_text(json.dumps(document))
    return path


def packed(sample: Sample) -> Sample:
    """Return a writer of another sample in gzip form."""

    def write(folder: Path) -> Path:
        path = sample(folder)
        found = path.with_name(f"{path.name}.gz")
        found.write_bytes(gzip.compress(path.read_bytes(), mtime=0))
        path.unlink()
        return found

    return write


def _json(folder: Path, name: str, document: Any) -> Path:
    (folder / name).write_text(json.dumps(document))
    return folder / name


def _text(folder: Path, name: str, text: str) -> Path:
    (folder / name).write_text(text)
    return folder / name


def _installed(folder: Path, *place: str) -> Path:
    return Path(shutil.copy(share_folder().joinpath("config", *place), folder / place[-1]))


def pack_rig(folder: Path) -> Path:
    """Write calibration.json of a data pack."""
    cameras = [
        {
            "name": camera.name,
            "K": camera.intrinsics.matrix.tolist(),
            "distortion": [0.0] * 5,
            "width": 64,
            "R": camera.cam_from_world.rotation.tolist(),
            "t": camera.cam_from_world.translation.tolist(),
            "height": 48,
        }
        for camera in rig().cameras
    ]
    return _json(folder, "calibration.json", {"unit": "m", "cameras": cameras})


def total_capture_rig(folder: Path) -> Path:
    """Write calibration.cal of Total Capture with two cameras."""
    one = "0 47 0 63\n60 60 31.5 23.5\n0.01\n1 0 0\n0 1 0\n0 0 1\n0 0 4\n"
    return _text(folder, "calibration.cal", "2 1\n" + one + one)


def detections(folder: Path) -> Path:
    """Write detections of two persons in three views at two timestamps."""
    names = list(load_skeleton("panoptic19").joint_names)
    person = [[10.0 + k, 20.0, 0.9] for k in range(18)] + [None]
    frames = [
        {
            "index": k,
            "stamp_ns": SECOND + k,
            "views": {name: {"stamp_ns": SECOND + k, "persons": [person, person]} for name in rig().names},
        }
        for k in range(2)
    ]
    return _json(
        folder,
        "detections.json",
        {"format": "panoptic-detections-1", "joint_names": names, "frames": frames},
    )


def skeletons(folder: Path) -> Path:
    """Write skeletons of two persons at two timestamps."""
    names = list(load_skeleton("panoptic19").joint_names)
    joints = [[0.1 * k, 0.2, 1.0] for k in range(18)] + [None]
    covariances = [[1e-4, 0.0, 0.0, 1e-4, 0.0, 1e-4]] * 18 + [None]
    people = [
        {
            "id": k,
            "joints": joints,
            "scores": [0.9] * 18 + [0.0],
            "covariances": covariances,
            "ignore": False,
            "views": [3] * 18 + [0],
        }
        for k in range(2)
    ]
    frames = [{"index": k, "stamp_ns": SECOND + k, "skeletons": people} for k in range(2)]
    return _json(
        folder, "skeletons.json", {"format": "panoptic-skeletons-1", "joint_names": names, "frames": frames}
    )


def annotation(folder: Path) -> Path:
    """Write hand-annotated joints in the format of the Shelf data set."""
    frames = {"300": [{"id": 0, "joints": [[0.0, 0.0, 1.0], [0.1, 0.0, 1.0]]}], "301": []}
    return _json(folder, "truth.json", {"unit": "m", "joint_names": ["a", "b"], "frames": frames})


def bodies(folder: Path) -> Path:
    """Write one body at one timestamp."""
    model = read_body_model()
    count, covariances = len(model.names), [[1e-4, 0, 0, 1e-4, 0, 1e-4]] * len(model.names)
    body = {
        "id": 0,
        "positions": [[0.0, 0.0, 1.0]] * count,
        "orientations": [[1.0, 0.0, 0.0, 0.0]] * count,
        "joint_angles": [0.0] * (3 * count - 3),
        "velocities": [[0.0] * 3] * count,
        "angular_velocities": [[0.0] * 3] * count,
        "position_covariances": covariances,
        "orientation_covariances": covariances,
    }
    frames = [{"index": 0, "stamp_ns": SECOND, "subjects": [body]}]
    return _json(
        folder,
        "kinematics.json",
        {
            "format": "panoptic-kinematics-1",
            "segment_names": list(model.names),
            "joint_names": list(model.joint_names),
            "frames": frames,
        },
    )


def subject(folder: Path) -> Path:
    """Write a subject with a bone, a keypoint and a device."""
    model = read_body_model()
    name, point = model.names[1], next(iter(model.keypoints))
    return _json(
        folder,
        "subject.json",
        {
            "format": "panoptic-subject-1",
            "id": 1,
            "height_m": 1.8,
            "inertial_frame": "world",
            "segments": {name: [0.0, 0.0, 0.1]},
            "keypoints": {point: {"segment": name, "offset": [0.0, 0.0, 0.1]}},
            "devices": [{"device": "a", "segment": name, "position": [0, 0, 0], "mount": [1, 0, 0, 0]}],
            "start": [0.0, 0.0, 1.0],
            "t_pose": {"from_ns": 0, "to_ns": SECOND, "facing": [1, 0, 0]},
        },
    )


def imus(folder: Path) -> Path:
    """Write three samples of two IMUs."""
    head = "device,stamp_ns,qw,qx,qy,qz,gx,gy,gz,ax,ay,az\n"
    rows = (f"{name},{k}000,1,0,0,0,,,,0.1,0.2,9.81\n" for k in range(1, 4) for name in "ab")
    return _text(folder, "imu.csv", head + "".join(rows))


def timestamps(folder: Path) -> Path:
    """Write three frames of two cameras."""
    rows = (f"cam0{c},{k},{k}000000\n" for c in range(2) for k in range(3))
    return _text(folder, "timestamps.csv", "camera,frame,stamp_ns\n" + "".join(rows))


def clocks(folder: Path) -> Path:
    """Write clocks and line delays of two cameras."""
    clock = {"offset_s": 0.01, "offset_sd_s": 1e-3, "drift_ppm": 20.0, "drift_sd_ppm": 9.0}
    line = {"line_delay_us": 15.0, "line_delay_sd_us": 0.5}
    cameras = {name: {**clock, **line, "observable": True} for name in ("cam00", "cam01")}
    document = {"format": "panoptic-clocks-1", "reference_ns": 0, "cameras": cameras}
    return _json(folder, "clocks.json", document)


def offsets(folder: Path) -> Path:
    """Write clock offsets of two cameras in the older format."""
    rows = [
        {
            "name": name,
            "offset_s": 0.01,
            "offset_std_s": 1e-3,
            "drift": 0.0,
            "drift_std": 0.0,
            "applied": True,
        }
        for name in ("cam00", "cam01")
    ]
    return _json(folder, "offsets.json", {"format": "panoptic-offsets-1", "cameras": rows})


def synctables(folder: Path) -> Path:
    """Write timestamps of CMU's HD cameras and of one Kinect."""
    table = {"univ_time": [100.0, 133.3, -1.0, 200.0], "index": [0, 1, 2, 3]}
    kinect = {kind: {"KINECTNODE1": table} for kind in ("color", "depth")}
    return _json(folder, "synctables_a.json", {"hd": table, "kinect": kinect})


def parameters(folder: Path) -> Path:
    """Write parameters of two stages, one of them in the layout of ROS."""
    text = "sync:\n  ros__parameters:\n    window_s: 0.01\ntracking: {max_distance: 0.3}\n"
    text += "voting: {method: exact}\n"
    return _text(folder, "parameters.yaml", text)


def preset(folder: Path) -> Path:
    """Write a preset with a skeleton."""
    return _text(folder, "preset.yaml", "skeleton: panoptic15\nvoting:\n  method: exact\n  voxel: 0.04\n")


def skeleton(folder: Path) -> Path:
    """Write a copy of an installed skeleton."""
    return _installed(folder, "skeletons", "panoptic19.yaml")


def segments(folder: Path) -> Path:
    """Write a copy of the installed body segments."""
    return _installed(folder, "bodies", "segments21.yaml")


def card(folder: Path) -> Path:
    """Write a copy of an installed model card."""
    return _installed(folder, "models", "movenet-multipose.yaml")


def topics(folder: Path) -> Path:
    """Write the topics of a camera driver and a depth sensor driver."""
    text = "left: {image: /left/image_raw, camera_info: /left/camera_info, encoding: bayer_rggb8}\n"
    text += "kinect:\n  depth: /k/depth\n  camera_info: /k/camera_info\nfixed_frame: map\n"
    return _text(folder, "topics.yaml", text)


def bias(folder: Path) -> Path:
    """Write a copy of an installed bias table."""
    return _installed(folder, "biases", "movenet-multipose-panoptic19.yaml")


def joint_offsets(folder: Path) -> Path:
    """Write the detector's offset of one joint in its body segment."""
    model = read_body_model()
    rows = f"  left_hip: {{frame: {model.keypoints['lHip'][0]}, offset: [0.01, 0.0, 0.02]}}\n"
    return _text(folder, "offsets.yaml", "format: panoptic-joint-offsets-1\nsource: test\noffsets:\n" + rows)


def sound_names(folder: Path) -> Path:
    """Write sound.yaml next to a recording."""
    write_wav(folder / "timecode.wav", 8000, np.zeros((80, 2)))
    return _text(folder, "sound.yaml", "timecode.wav: {clocks: [A, B], start_ns: 5}\n")


def prior(folder: Path) -> Path:
    """Write a copy of the installed pose prior."""
    return _installed(folder, "bodies", "prior-cmu.npz")


def clips(folder: Path) -> Path:
    """Write two clips of joints."""
    joints = np.zeros((4, 2, 3), np.float32)
    arrays: dict[str, Any] = {"clip_a": joints, "clip_b": joints}
    np.savez(folder / "clips.npz", clips=["a", "b"], joint_names=["x", "y"], fps=30.0, **arrays)
    return folder / "clips.npz"


def occluders(folder: Path) -> Path:
    """Write a box and a triangle."""
    mesh = {"name": "m", "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "triangles": [[0, 1, 2]]}
    box = {"name": "b", "size": [1, 1, 1], "centre": [0, 0, 0.5], "R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}
    return _json(
        folder,
        "occluders.json",
        {"format": "panoptic-occluders-1", "units": "m", "boxes": [box], "meshes": [mesh]},
    )


_PLY = (
    "ply\nformat {}\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
    "property list uchar int vertex_indices\nend_header\n"
)


def ply(folder: Path) -> Path:
    """Write a triangle as ASCII PLY."""
    return _text(folder, "a.ply", _PLY.format("ascii 1.0") + "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")


def binary_ply(folder: Path) -> Path:
    """Write a triangle as binary PLY."""
    body = np.array([0, 0, 0, 1, 0, 0, 0, 1, 0], "<f4").tobytes()
    body += b"\3" + np.array([0, 1, 2], "<i4").tobytes()
    (folder / "b.ply").write_bytes(_PLY.format("binary_little_endian 1.0").encode() + body)
    return folder / "b.ply"


def obj(folder: Path) -> Path:
    """Write a triangle as Wavefront OBJ."""
    text = "# made\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 3//1\nf -1 -2 -3\n"
    return _text(folder, "a.obj", text)


def bvh(folder: Path) -> Path:
    """Write two joints in two frames as BVH."""
    return _text(
        folder,
        "a.bvh",
        (
            "HIERARCHY\nROOT Hips\n{\n OFFSET 0 0 0\n CHANNELS 6 Xposition Yposition Zposition "
            "Zrotation Xrotation Yrotation\n JOINT Chest\n {\n  OFFSET 0 5 0\n"
            "  CHANNELS 3 Zrotation Xrotation Yrotation\n  End Site\n  {\n   OFFSET 0 5 0\n"
            "  }\n }\n}\nMOTION\nFrames: 2\nFrame Time: 0.033\n"
            "0 90 0 0 0 0 0 0 0\n0 91 0 1 2 3 4 5 6\n"
        ),
    )


def c3d(folder: Path) -> Path:
    """Write two points in two frames as C3D."""
    made: Any = importlib.import_module("ezc3d").c3d()
    made["parameters"]["POINT"]["RATE"]["value"] = [100.0]
    made["parameters"]["POINT"]["LABELS"]["value"] = ["a", "b"]
    made["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    made["data"]["points"] = np.ones((4, 2, 2))
    made.write(str(folder / "a.c3d"))
    return folder / "a.c3d"


def human36m(folder: Path) -> Path:
    """Write metadata.xml with 300 numbers."""
    numbers = [0.1] * 264 + [1000.0, 1000.0, 500.0, 500.0, 0.0, 0.0, 0.0, 0.0, 0.0] * 4
    text = " ".join(map(str, numbers))
    return _text(folder, "metadata.xml", f"<Metadata><mapping/><w0>[{text}]</w0></Metadata>")


def wav(folder: Path) -> Path:
    """Write 0.01 s of two channels as WAV."""
    write_wav(folder / "a.wav", 8000, np.zeros((80, 2)))
    return folder / "a.wav"


def _picture() -> np.ndarray:
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]]
    return np.stack([rows * 5, columns * 4, rows + columns], axis=-1).astype(np.uint8)


def image(suffix: str) -> Sample:
    """Return a writer of a folder with two images; it returns the path of the second."""

    def write(folder: Path) -> Path:
        import cv2  # 17 MB; processes without images do not load it

        (folder / "cam00").mkdir()
        for name in "01":
            cv2.imwrite(str(folder / "cam00" / f"{name}{suffix}"), _picture())
        return folder / "cam00" / f"1{suffix}"

    return write


def depth(folder: Path) -> Path:
    """Write a depth map as 16-bit PNG."""
    import cv2  # imported here for the same reason

    cv2.imwrite(str(folder / "0.png"), _picture()[..., 0].astype(np.uint16) * 10)
    return folder / "0.png"


def video(folder: Path) -> Path:
    """Write four frames as MP4."""
    from panoptic_ros.view.video_file import VideoFile  # needs an encoder

    with VideoFile(folder / "a.mp4", SIZE, 25.0) as film:
        for _ in range(4):
            film.write(_picture())
    return folder / "a.mp4"


def bag(name: str) -> Sample:
    """Return a writer of a bag with two detection messages; it returns the path of one file."""

    def write(folder: Path) -> Path:
        model = load_skeleton("panoptic19")
        points = np.full((1, len(model), 2), 10.0)
        scores = np.full((1, len(model)), 0.9)
        with BagWriter(folder / "bag") as writer:
            for k in range(2):
                view = ViewDetections("cam00", SECOND + k, k, SIZE, model.hash, points, scores, scores.max(1))
                writer.write("/cam00/detections", SECOND + k, to_message(view, bag_messages()))
        return next((folder / "bag").glob(f"*{Path(name).suffix}"))

    return write
