"""Table of all input formats: a small sample and the reader of each, for trials with damaged copies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from panoptic_ros.domain import SkeletonModel
from panoptic_ros.io.bags import BagReader
from panoptic_ros.io.biases import read_bias_table
from panoptic_ros.io.body_files import read_bodies
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.clock_files import read_clocks
from panoptic_ros.io.compared_skeletons import read_sequence
from panoptic_ros.io.driver_topics import read_driver_topics
from panoptic_ros.io.joint_offsets import read_joint_offsets
from panoptic_ros.io.kinematic_files import read_imus, read_subject
from panoptic_ros.io.messages import from_message
from panoptic_ros.io.models.cards import read_card
from panoptic_ros.io.motion_files import read_bvh, read_clip_arrays
from panoptic_ros.io.occluders import read_occluders
from panoptic_ros.io.plain_formats import read_detections, read_skeletons
from panoptic_ros.io.pose_prior import read_prior
from panoptic_ros.io.rigs import read_rig
from panoptic_ros.io.rigs.intrinsics import read_intrinsics
from panoptic_ros.io.skeletons import load_skeleton, map_joints
from panoptic_ros.io.stamps import read_stamps, stamps_of_frames
from panoptic_ros.io.synctables import read_synctables
from panoptic_ros.io.wav import WavFile, read_wav
from panoptic_ros.running.plans.parameters import read_parameters
from panoptic_ros.running.plans.presets import read_preset
from panoptic_ros.study.faults import samples

Sample = Callable[[Path], Path]


@dataclass(frozen=True)
class Format:
    """Sample and reader of one format.

    Args:
        sample: writes a complete file, and the files it refers to, into a folder; returns its path.
        read: reads everything in a file, or raises a `PanopticError`.
    """

    sample: Sample
    read: Callable[[Path], object]


@lru_cache(maxsize=1)
def _model() -> Any:
    return read_body_model()


@lru_cache(maxsize=1)
def _skeleton() -> SkeletonModel:
    return load_skeleton("panoptic19")


def _rig(path: Path) -> None:
    """Read a rig and project a point into its cameras."""
    rig = read_rig(path)
    for camera in rig.cameras:
        camera.project(samples.POINT)


def _rig_beside(path: Path) -> None:
    _rig(path.parent)


def _detections(path: Path) -> None:
    people = read_detections(path)
    model, joint_map = map_joints("panoptic19", people.joint_names)
    known = {name for frame in people.frames for name in frame.views}
    list(people.sets(samples.rig(), joint_map, model.hash, known))


def _skeletons(path: Path) -> None:
    read_skeletons(path)
    read_sequence(path)


def _skeleton_file(path: Path) -> None:
    from panoptic_ros.io import skeletons

    skeletons._document.cache_clear()  # the cache key is the path, and the file at this path has changed
    model, _ = map_joints(str(path), _skeleton().joint_names)
    replace(model)


def _timestamps(path: Path) -> None:
    stamps_of_frames(path, read_stamps(path))


def _sync_tables(path: Path) -> None:
    for stream in read_synctables(path).values():
        stream.stamps()
        stream.nearest(100.0)


def _sound_names(path: Path) -> None:
    from panoptic_ros.capture.sound.folder import folder_sounds

    folder_sounds(path.parent, {"cam00": 0}, {})


def _wav(path: Path) -> None:
    read_wav(path)
    WavFile(path).samples(0, 100)


def _images(path: Path) -> None:
    from panoptic_ros.capture.image_folder import ImageFolderSource

    with ImageFolderSource("cam00", path.parent) as source:
        list(source)


def _depth(path: Path) -> None:
    from panoptic_ros.capture.depth_folder import read_depth

    read_depth(path)


def _video(path: Path) -> None:
    from panoptic_ros.capture.video import VideoSource

    with VideoSource("cam00", path) as source:
        list(source)


def _bag(path: Path) -> None:
    """Read all messages of a bag folder."""
    with BagReader(path.parent) as bag:
        for topic, _, message in bag.messages():
            if topic.endswith("/detections"):
                from_message(message, "ViewDetections")


def _human36m(path: Path) -> None:
    from panoptic_ros.io.datasets.human36m import read_cameras

    read_cameras(path, 1)


def _c3d(path: Path) -> None:
    from panoptic_ros.io.c3d_motion import read_c3d

    read_c3d(path)


FORMATS: dict[str, Format] = {
    "rig.json": Format(samples.rig_file("rig.json"), _rig),
    "rig.json.gz": Format(samples.packed(samples.rig_file("rig.json")), _rig),
    "lenses without poses": Format(samples.lenses, read_intrinsics),
    "rig of CMU": Format(samples.rig_file("panoptic", "cmu.json"), _rig),
    "rig of a pack": Format(samples.pack_rig, _rig),
    "rig of Qualisys": Format(samples.rig_file("qca", "rig.qca.txt"), _rig),
    "rig of caliscope": Format(samples.rig_file("caliscope", "rig.toml"), _rig),
    "rig of aniposelib": Format(samples.rig_file("aniposelib", "rig.toml"), _rig),
    "rig of Total Capture": Format(samples.total_capture_rig, _rig),
    "poses.yaml": Format(samples.camera_info("poses.yaml"), _rig_beside),
    "camera_info": Format(samples.camera_info("cam00.yaml"), _rig_beside),
    "detections.json": Format(samples.detections, _detections),
    "detections.json.gz": Format(samples.packed(samples.detections), _detections),
    "skeletons.json.gz": Format(samples.packed(samples.skeletons), _skeletons),
    "annotation": Format(samples.annotation, read_sequence),
    "kinematics.json.gz": Format(samples.packed(samples.bodies), read_bodies),
    "subject.json": Format(samples.subject, lambda path: read_subject(path, _model())),
    "imu.csv": Format(samples.imus, read_imus),
    "timestamps.csv": Format(samples.timestamps, _timestamps),
    "clocks.json": Format(samples.clocks, read_clocks),
    "offsets.json": Format(samples.offsets, read_clocks),
    "synctables": Format(samples.synctables, _sync_tables),
    "parameters": Format(samples.parameters, lambda path: read_parameters(path, ())),
    "preset": Format(samples.preset, lambda path: read_preset(str(path))),
    "skeleton": Format(samples.skeleton, _skeleton_file),
    "segments": Format(samples.segments, lambda path: read_body_model(str(path))),
    "model card": Format(samples.card, lambda path: read_card(str(path))),
    "topics": Format(samples.topics, read_driver_topics),
    "bias table": Format(samples.bias, lambda path: read_bias_table(str(path), _skeleton())),
    "joint offsets": Format(samples.joint_offsets, lambda path: read_joint_offsets(path, _model())),
    "sound.yaml": Format(samples.sound_names, _sound_names),
    "pose prior": Format(samples.prior, lambda path: read_prior(str(path), _model())),
    "clips": Format(samples.clips, read_clip_arrays),
    "occluders.json": Format(samples.occluders, read_occluders),
    "PLY": Format(samples.ply, read_occluders),
    "binary PLY": Format(samples.binary_ply, read_occluders),
    "OBJ": Format(samples.obj, read_occluders),
    "BVH": Format(samples.bvh, lambda path: read_bvh(path, 0.01)),
    "C3D": Format(samples.c3d, _c3d),
    "metadata.xml": Format(samples.human36m, _human36m),
    "WAV": Format(samples.wav, _wav),
    "PNG": Format(samples.image(".png"), _images),
    "JPEG": Format(samples.image(".jpg"), _images),
    "depth map": Format(samples.depth, _depth),
    "video": Format(samples.video, _video),
    "bag": Format(samples.bag("bag.mcap"), _bag),
    "metadata.yaml": Format(samples.bag("metadata.yaml"), _bag),
}
