"""The bench `ablation`: its options, its cases, and what came of them."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from typing import Any

from panoptic_ros.bench.ablation.mechanisms import chosen
from panoptic_ros.bench.ablation.summary import Samples, summary
from panoptic_ros.bench.ablation.variants import VARIANTS, split
from panoptic_ros.bench.ablation.worlds import QUICK, SIMULATED, frames_of
from panoptic_ros.bench.child import run_child
from panoptic_ros.errors import UsageError
from panoptic_ros.stage import Progress, untold

CASE = "panoptic_ros.bench.ablation.case"
RECORDING_COST = 3000.0  # of a recording whose size is not known yet, in frames x people x views
RENDERING_COST = 4.0  # of a rendered frame over a simulated one
QUICK_FRAMES, QUICK_SEEDS = 30, 2


@dataclass(frozen=True)
class _Job:
    """One process. cost: about, for the time left."""

    title: str
    request: dict[str, Any]
    cost: float


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the bench."""
    parser.add_argument("--seeds", type=int, default=3, metavar="N", help="how many; default 3")
    parser.add_argument("--first-seed", type=int, default=0, metavar="N", help="default 0")
    parser.add_argument(
        "--scenes",
        default=",".join(SIMULATED),
        metavar="NAME,NAME",
        help="of `panoptic simulate`; behind the name of one that is not rendered "
        f"{', '.join('+' + word for word in VARIANTS)} (drawn score maps; somebody whom these alone show; "
        f"two cameras only); empty = none; default {','.join(SIMULATED)}",
    )
    parser.add_argument(
        "--capture",
        nargs="+",
        action="append",
        default=[],
        metavar="PATH",
        dest="captures",
        help="a recording with its truth: a folder (rig.json, detections.json.gz, truth.json.gz); or a bag "
        "(or folder) of `panoptic run` and TRUTH; or RIG DETECTIONS TRUTH. May be given several times",
    )
    parser.add_argument("--only", default="", metavar="NAME,NAME", help="these mechanisms, or these parts")
    parser.add_argument("--frames", type=int, metavar="N", help="of each scene at most")
    parser.add_argument("--model", default="movenet-multipose", help="detector of rendered scenes")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="processes at a time; default 1")
    parser.add_argument("--quick", action="store_true", help="three scenes, two seeds, few frames")


def measure(args: argparse.Namespace, progress: Progress = untold) -> dict[str, Any]:
    """Every case in a process of one thread, by default and with each mechanism off.

    Raises:
        UsageError: on scenes and mechanisms that are not there, and numbers that make no sense.
        UserError: if a recording or the detector cannot be read.
        EnvironmentProblem: if a case fails.
    """
    mechanisms = chosen(_words(args.only))
    jobs = _jobs(args, [mechanism.name for mechanism in mechanisms])
    samples: dict[str, dict[str, Samples]] = {}
    for job, answer in zip(jobs, _answers(jobs, args.jobs, progress)):
        own = samples.setdefault(job.title, {})
        for name, figures in answer["runs"].items():
            own.setdefault(name, []).extend(figures)
    return {
        "bench": "ablation",
        "seeds": _seeds(args),
        "threads": 1,
        "mechanisms": [{"part": m.part, "name": m.name, "about": m.about, "off": m.off} for m in mechanisms],
        "scenes": summary(samples, [mechanism.name for mechanism in mechanisms]),
    }


def _jobs(args: argparse.Namespace, only: list[str]) -> list[_Job]:
    """All cases, those of a scene one after another."""
    _check_numbers(args)
    scenes = _words(args.scenes)
    if args.quick and args.scenes == ",".join(SIMULATED):
        scenes = list(QUICK)
    if not scenes and not args.captures:
        raise UsageError("there is nothing to solve: give --scenes or --capture")
    jobs = [_scene_job(name, seed, args, only) for name in scenes for seed in _seeds(args)]
    return jobs + [
        _Job(" ".join(paths), {"paths": paths, "only": only}, RECORDING_COST) for paths in args.captures
    ]


def _check_numbers(args: argparse.Namespace) -> None:
    for name, least in (("seeds", 1), ("first_seed", 0), ("jobs", 1), ("frames", 3)):
        value = getattr(args, name)
        if value is not None and value < least:
            raise UsageError(f"--{name.replace('_', '-')} {value}: it must be at least {least}")
    for paths in args.captures:
        if len(paths) > 3:
            raise UsageError(f"--capture {' '.join(paths)}: give a folder, a bag and a truth, or three files")


def _scene_job(name: str, seed: int, args: argparse.Namespace, only: list[str]) -> _Job:
    scene, _ = split(name)
    most = QUICK_FRAMES if args.quick and args.frames is None else args.frames
    frames = frames_of(name, most)
    request = {"scene": name, "seed": seed, "frames": frames, "model": args.model, "only": only}
    views = getattr(scene.rig, "cameras", 1)
    cost = frames * (len(scene.activities) + 2) * views * (RENDERING_COST if scene.rendered else 1.0)
    return _Job(name, request, cost)


def _answers(jobs: Sequence[_Job], at_once: int, progress: Progress) -> list[dict[str, Any]]:
    """What the processes of all jobs found, in the order of the jobs."""
    progress(0.0, jobs[0].title)
    whole, done = sum(job.cost for job in jobs), 0.0
    with ThreadPoolExecutor(at_once) as pool:
        running = {pool.submit(run_child, CASE, job.request): job for job in jobs}
        try:
            for future in as_completed(running):
                future.result()
                done += running[future].cost
                progress(min(1.0, done / whole), f"{running[future].title} is done")
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
        return [future.result() for future in running]


def _seeds(args: argparse.Namespace) -> list[int]:
    count = min(args.seeds, QUICK_SEEDS) if args.quick else args.seeds
    return list(range(args.first_seed, args.first_seed + count))


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]
