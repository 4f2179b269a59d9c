"""`panoptic simulate SCENE`: simulate 2D poses or a capture folder, with exact truth."""

from __future__ import annotations

import argparse
import sys

from panoptic_ros.errors import UsageError
from panoptic_ros.running.arguments import output_folder
from panoptic_ros.running.simulations.bodies import write_body_take
from panoptic_ros.running.simulations.body_scenes import BODY_SCENES, OTHER_BODY_SCENES
from panoptic_ros.running.simulations.takes import scene_lines, write_take


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb."""
    parser.add_argument("scene", nargs="?", metavar="SCENE", help="name of a scene, see --list")
    parser.add_argument("--list", action="store_true", help="list the scenes and exit")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="number of the take (default 0)")
    parser.add_argument("--out", type=output_folder, metavar="DIR", help="folder to write into")
    parser.add_argument(
        "--frames", type=int, metavar="F", help="number of frames, instead of the scene's own"
    )
    parser.add_argument(
        "--images", action="store_true", help="rendered scenes: write PNG folders instead of videos"
    )
    parser.add_argument(
        "--bag", action="store_true", help="also write 2D people, sound and IMU data as a bag"
    )
    parser.add_argument(
        "--tracks",
        action="store_true",
        help="rendered scenes with timecode: write it as sound tracks of the videos, and no other timestamps",
    )
    parser.add_argument(
        "--depth", action="store_true", help="rendered scenes: write depth and person ids as PNG"
    )


def run(args: argparse.Namespace) -> int:
    """Write a take of a scene, completely or not at all."""
    bodies = BODY_SCENES | OTHER_BODY_SCENES
    if args.list:
        print("\n".join(f"{name:<20}{line}" for name, line in (scene_lines() | bodies).items()))
        return 0
    if args.scene is None or args.out is None:
        raise UsageError("name a scene and a folder: panoptic simulate SCENE --out DIR (see --list)")
    if args.scene in bodies:
        print(f"{args.out}: {write_body_take(args.scene, args.out, args.seed, args.bag, args.frames)}")
        return 0
    take = write_take(
        args.scene,
        args.out,
        seed=args.seed,
        frames=args.frames,
        images=args.images,
        depth=args.depth,
        bag=args.bag,
        tracks=args.tracks,
        on_camera=_progress,
    )
    size = f"{len(take.schedule.ticks)} frames, {len(take.rig)} cameras, {len(take.people)} people"
    print(f"{args.out}: {args.scene}, {size}")
    return 0


def _progress(camera: str, done: int, total: int) -> None:
    """Print a progress line on a terminal; each line replaces the previous one, and the last clears it."""
    if sys.stderr.isatty():
        text = f"rendered {camera}, {done} of {total} cameras" if done < total else ""
        print(f"\r\033[K{text}", end="", file=sys.stderr, flush=True)
