"""Writes takes of simulated scenes to files: completely, or not at all."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from panoptic_ros.errors import UsageError
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.bags import BagWriter
from panoptic_ros.io.files import write_bytes, write_json
from panoptic_ros.io.folders import staged_folder
from panoptic_ros.io.messages import bag_messages, to_message
from panoptic_ros.io.occluders import FILE as OCCLUDERS
from panoptic_ros.io.occluders import write_occluders
from panoptic_ros.io.plain_formats import write_detections
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.io.wav import write_wav
from panoptic_ros.simulation import SCENES, SKELETON, Simulation, scene, simulate
from panoptic_ros.simulation.generators import EARLY_S, RECORDER, SAMPLE_RATE, recorded, recorded_blocks
from panoptic_ros.simulation.heard import heard_blocks, heard_by


def scene_lines() -> dict[str, str]:
    """Return one line about every scene, by its name."""
    return {
        name: f"{len(item.activities)} people, {item.frames} frames: {item.about}"
        for name, item in SCENES.items()
    }


def write_take(
    name: str,
    out: Path,
    *,
    seed: int = 0,
    frames: int | None = None,
    images: bool = False,
    depth: bool = False,
    bag: bool = False,
    tracks: bool = False,
    on_camera: Callable[[str, int, int], None] = lambda camera, done, total: None,
) -> Simulation:
    """Simulate a scene and write its rig, truth, and 2D poses or, for rendered scenes, videos.

    Args:
        out: Folder, created if needed.
        seed: Random seed. Another seed gives another take.
        frames: Number of frames; None = that of the scene.
        images: Write folders of PNG files instead of videos.
        depth: Also write depth and person ids as PNG.
        bag: Also write the 2D poses, and sound if there is any, to a bag.
        tracks: Write timecode as sound tracks of the videos, instead of a WAV file and timestamps.
        on_camera: Callback with the name of a rendered camera, the number of rendered cameras, and the total.

    Raises:
        UsageError: if there is no such scene, or it has no images although they are requested.
        EnvironmentProblem: if files cannot be written.
    """
    take = simulate(scene(name), seed, frames)
    if not take.scene.rendered and (images or depth):
        rendered = ", ".join(name for name, item in SCENES.items() if item.rendered)
        raise UsageError(f"{name} has no images; scenes with images are {rendered}")
    if take.scene.rendered and bag:
        raise UsageError(f"{name} has images, and is written as a capture folder only; leave --bag out")
    if tracks and (images or not (take.scene.rendered and take.scene.timing.generators)):
        fitting = ", ".join(n for n, s in SCENES.items() if s.rendered and s.timing.generators)
        raise UsageError(f"--tracks is for videos with timecode: {fitting}, without --images")
    with staged_folder(out) as folder:
        write_rig(folder / "rig.json", take.rig)
        if take.rig.occluders is not None:
            write_occluders(folder / OCCLUDERS, take.rig.occluders)
        write_json(folder / "truth.json.gz", take.truth_document())
        if take.scene.timing.generators and not tracks:
            _write_sound(folder, take)
        if take.clocks:
            _write_heard(folder, take)
        if take.scene.rendered:
            from panoptic_ros.running.simulations.images import write_capture  # numba is slow to load

            cameras = write_capture(folder, take, images=images, depth=depth, tracks=tracks)
            for done, camera in enumerate(cameras, start=1):
                on_camera(camera, done, len(take.rig))
        else:
            write_detections(folder / "detections.json.gz", SKELETON.joint_names, take.detection_sets())
        if bag:
            _write_bag(folder / "bag", take)
    return take


def _write_sound(folder: Path, take: Simulation) -> None:
    """Write one recorder's sound of all generators, and the assignment of its channels to clocks."""
    generators = take.scene.timing.generators
    write_wav(folder / f"{RECORDER}.wav", SAMPLE_RATE, recorded(generators, take.seconds))
    clocks = ", ".join(generator.clock for generator in generators)
    write_bytes(folder / "sound.yaml", f"{RECORDER}.wav: [{clocks}]\n".encode())


def _write_heard(folder: Path, take: Simulation) -> None:
    """Write the sound that each camera records, and the time of its clock at the first sample."""
    lines = []
    for name, recorder, samples in heard_by(take):
        write_wav(folder / f"{name}.wav", recorder.sample_rate, samples)
        lines.append(f"{name}.wav: {{clocks: [], start_ns: {round(1e9 * recorder.clock_s)}}}\n")
    write_bytes(folder / "sound.yaml", "".join(lines).encode())


def _write_bag(path: Path, take: Simulation) -> None:
    """Write rig, skeleton, 2D poses and sound to a bag. Recording times are in master time."""
    family, begin = bag_messages(), max(take.master_ns(-EARLY_S), 0)  # a bag cannot hold times before 0
    with BagWriter(path) as bag:
        for key, record in (("rig", take.rig), ("skeleton_model", SKELETON)):
            bag.write("/" + TOPICS[key].name, begin, to_message(record, family))
        generators = take.scene.timing.generators
        for block in recorded_blocks(generators, take.seconds) if generators else ():
            when = take.master_ns(block.first_sample / SAMPLE_RATE - EARLY_S)
            bag.write("/" + TOPICS["audio"].of(block.device), when, to_message(block, family))
        for since, block in heard_blocks(take) if take.clocks else ():
            when = take.master_ns(since)
            bag.write("/" + TOPICS["audio"].of(block.device), when, to_message(block, family))
        for item in take.detection_sets():
            for view in item.views:
                bag.write("/" + TOPICS["detections"].of(view.camera), item.stamp_ns, to_message(view, family))
