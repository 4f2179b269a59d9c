"""`panoptic simulate SCENE`: 2D people or a capture folder, with exact truth."""
from __future__ import annotations

import argparse
import sys
from pathlib import Path

from panoptic_ros.errors import UsageError
from panoptic_ros.io.files import write_json
from panoptic_ros.io.folders import staged_folder
from panoptic_ros.io.occluders import FILE as OCCLUDERS
from panoptic_ros.io.occluders import write_occluders
from panoptic_ros.io.plain_formats import write_detections
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.simulation import SCENES, SKELETON, Scene, Simulation, scene, simulate


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("scene", nargs="?", metavar="SCENE", help="name of a scene, see --list")
    parser.add_argument("--list", action="store_true", help="list the scenes and end")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="another take (default 0)")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder to write into")
    parser.add_argument("--frames", type=int, metavar="F", help="in place of the scene's own number")
    parser.add_argument("--images", action="store_true", help="rendered scenes: PNG folders, not videos")
    parser.add_argument("--depth", action="store_true", help="rendered scenes: depth and person ids as PNG")


def run(args: argparse.Namespace) -> int:
    """Write a take of a scene, whole or not at all."""
    if args.list:
        print("\n".join(f"{name:<20}{summary(item)}" for name, item in SCENES.items()))
        return 0
    if args.scene is None or args.out is None:
        raise UsageError("name a scene and a folder: panoptic simulate SCENE --out DIR (see --list)")
    take = simulate(scene(args.scene), args.seed, args.frames)
    if not take.scene.rendered and (args.images or args.depth):
        rendered = ", ".join(name for name, item in SCENES.items() if item.rendered)
        raise UsageError(f"{args.scene} has no images; scenes with images are {rendered}")
    with staged_folder(args.out) as folder:
        write_rig(folder / "rig.json", take.rig)
        if take.rig.occluders is not None:
            write_occluders(folder / OCCLUDERS, take.rig.occluders)
        write_json(folder / "truth.json.gz", take.truth_document())
        if take.scene.rendered:
            from panoptic_ros.cli.simulate_images import write_capture  # numba is slow to load

            for done, name in enumerate(write_capture(folder, take, args.images, args.depth), start=1):
                _progress(f"rendered {name}, {done} of {len(take.rig)} cameras")
            _progress("")
        else:
            write_detections(folder / "detections.json.gz", SKELETON.joint_names, take.detection_sets())
    print(f"{args.out}: {describe(args.scene, take)}")
    return 0


def summary(item: Scene) -> str:
    """One line about a scene."""
    return f"{len(item.activities)} people, {item.frames} frames: {item.about}"


def describe(name: str, take: Simulation) -> str:
    """One line about a take."""
    frames, cameras = len(take.schedule.ticks), len(take.rig)
    return f"{name}, {frames} frames, {cameras} cameras, {len(take.people)} people"


def _progress(text: str) -> None:
    """A line that the next one replaces, if somebody is watching."""
    if sys.stderr.isatty():
        print(f"\r\033[K{text}", end="", file=sys.stderr, flush=True)
