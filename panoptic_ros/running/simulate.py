"""Takes of simulated scenes in files: whole or not at all."""
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from panoptic_ros.errors import UsageError
from panoptic_ros.io.files import write_json
from panoptic_ros.io.folders import staged_folder
from panoptic_ros.io.occluders import FILE as OCCLUDERS
from panoptic_ros.io.occluders import write_occluders
from panoptic_ros.io.plain_formats import write_detections
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.simulation import SCENES, SKELETON, Simulation, scene, simulate


def scene_lines() -> dict[str, str]:
    """One line about every scene, by its name."""
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
    on_camera: Callable[[str, int, int], None] = lambda camera, done, total: None,
) -> Simulation:
    """Simulate a scene and write rig, truth, and 2D people or, of rendered scenes, videos.

    Args:
        out: folder; is made.
        seed: another take.
        frames: in place of the scene's own number.
        images: PNG folders in place of videos.
        depth: also depth and person ids as PNG.
        on_camera: called with the name of a camera that is rendered, how many are, and of how many.

    Raises:
        UsageError: if there is no such scene, or it has no images where they are asked for.
        EnvironmentProblem: if files cannot be written.
    """
    take = simulate(scene(name), seed, frames)
    if not take.scene.rendered and (images or depth):
        rendered = ", ".join(name for name, item in SCENES.items() if item.rendered)
        raise UsageError(f"{name} has no images; scenes with images are {rendered}")
    with staged_folder(out) as folder:
        write_rig(folder / "rig.json", take.rig)
        if take.rig.occluders is not None:
            write_occluders(folder / OCCLUDERS, take.rig.occluders)
        write_json(folder / "truth.json.gz", take.truth_document())
        if take.scene.rendered:
            from panoptic_ros.running.simulated_images import write_capture  # numba is slow to load

            for done, camera in enumerate(write_capture(folder, take, images, depth), start=1):
                on_camera(camera, done, len(take.rig))
        else:
            write_detections(folder / "detections.json.gz", SKELETON.joint_names, take.detection_sets())
    return take
