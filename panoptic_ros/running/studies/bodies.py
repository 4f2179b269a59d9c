"""The study of cameras and IMUs (Malleson et al. 2020, Fig. 7) on simulated captures, beside the paper's
solver."""
from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.domain.subjects import ViewPeople, ViewSeries
from panoptic_ros.evaluation.kinematic_scores import score_bodies
from panoptic_ros.io.body_models import read_body_model, read_clips
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.prior import PoseStatistics, other_sides, train_prior
from panoptic_ros.kinematics.session import Recording, solve_recording
from panoptic_ros.running.kinematics import PAPER, body_config
from panoptic_ros.running.simulations.bodies import body_scene
from panoptic_ros.simulation.bodies.capture import BodyCapture, simulate_body, sparse
from panoptic_ros.simulation.bodies.motion import Clip
from panoptic_ros.stage import Progress

CAMERAS, IMUS = (0, 1, 2, 4, 8), (0, 6, 13)
SKIPPED_S = 3.0
METHODS = ("ours", PAPER)
SHOWN = ("mm", "relative_mm", "procrustes_mm", "deg", "aligned_deg", "acc")


def study_bodies(
    scenes: Sequence[str], seed: int, cameras: Sequence[int], settings: Sequence[str], progress: Progress
) -> dict[str, Any]:
    """Errors by cameras, IMUs and method on one capture of each scene.

    The pose prior is trained without the motions of the capture. The captures are simulated: their figures
    are no reproduction of Total Capture.

    Args:
        settings: NAME=VALUE of the kinematics, for ours.
    """
    model, clips = read_body_model(), read_clips()
    configs = {"ours": body_config(settings=settings), PAPER: body_config(PAPER)}
    kinds = [(c, i) for c in cameras for i in IMUS if c or i]
    rows = []
    for n, name in enumerate(scenes):
        scene = body_scene(name)
        capture = simulate_body(scene, seed + n, model, clips)
        statistics = prior_without(scene.clips, clips, model)
        for k, (count, imus) in enumerate(kinds):
            done = (n * len(kinds) + k) / (len(scenes) * len(kinds))
            progress(done, f"{name}, {count} cameras, {imus} IMUs")
            part = sparse(capture, range(count), imus)
            for method in METHODS:
                scores = score_capture(part, configs[method], statistics)
                kind = {"scene": name, "seed": seed + n, "cameras": count, "imus": imus, "method": method}
                rows.append(kind | scores)
    return {"study": "kinematics", "scenes": list(scenes), "rows": rows}


def study_lines(result: dict[str, Any]) -> Iterator[str]:
    """The table: mean over the captures, and the worst ratio of ours to the paper's solver on one capture."""
    yield "simulated captures: no reproduction of Total Capture"
    names = "  ".join(key.rjust(13) for key in SHOWN)
    yield f"cameras IMUs  method         {names}  worst mm / deg of the paper's"
    rows = result["rows"]
    for cameras, imus in dict.fromkeys((row["cameras"], row["imus"]) for row in rows):
        mine = [row for row in rows if (row["cameras"], row["imus"]) == (cameras, imus)]
        by = {method: [row for row in mine if row["method"] == method] for method in METHODS}
        where = "mm" if cameras else "relative_mm"
        worst = [max(a[k] / b[k] for a, b in zip(by["ours"], by[PAPER])) for k in (where, "deg")]
        for method in METHODS:
            means = "  ".join(f"{np.mean([row[key] for row in by[method]]):13.1f}" for key in SHOWN)
            ratio = f"  {worst[0]:.2f} / {worst[1]:.2f}" if method == "ours" else ""
            yield f"{cameras:7} {imus:4}  {method:<13}  {means}{ratio}"


def score_capture(capture: BodyCapture, config: KinematicsConfig, statistics: PoseStatistics) -> dict[str,
Any]:
    """Errors, and milliseconds of processor time per instant."""
    began = time.process_time()
    solved = solve_recording(recording_of(capture), [capture.subject], config, statistics)
    spent = 1e3 * (time.process_time() - began) / len(capture.stamps)
    parents = capture.subject.body.model.parents
    return score_bodies(capture.truth(), solved.states, parents, SKIPPED_S) | {"ms": spent}


def recording_of(capture: BodyCapture) -> Recording:
    """What the solver gets of a capture."""
    if not len(capture.pixels):
        return Recording(None, capture.joint_names, {}, capture.devices)
    views = {}
    for c, camera in enumerate(capture.rig.cameras):
        pixels = capture.pixels[c]
        plane = np.full(pixels.shape, np.nan)
        there = np.isfinite(pixels).all(-1)
        plane[there] = camera.intrinsics.undistort(pixels[there])
        people = tuple(ViewPeople(plane[t][None], capture.scores[c, t][None]) for t in range(len(plane)))
        views[c] = ViewSeries(capture.stamps, people)
    return Recording(capture.rig, capture.joint_names, views, capture.devices)


def prior_without(left_out: Sequence[str], clips: dict[str, Clip], model: SegmentModel) -> PoseStatistics:
    """Statistics of the poses of all clips but these."""
    poses = np.concatenate([clip.vectors for name, clip in clips.items() if name not in left_out])
    return train_prior(poses, other_sides(model.names))
