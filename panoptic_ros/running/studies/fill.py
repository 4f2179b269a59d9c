"""`panoptic evaluate --study fill`: how bodies fit, and what they are worth to skeletons, by how many views
see a joint."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from heapq import merge
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.capture.imus import imu_samples
from panoptic_ros.domain import DetectionSet, RefinedPoseSet, TrackedPoseSet
from panoptic_ros.domain.bodies import BodyStateSet
from panoptic_ros.errors import UsageError
from panoptic_ros.evaluation import FramePair, SkeletonFrame, SkeletonSequence, pair_sequences
from panoptic_ros.geometry.torso import torso_frames
from panoptic_ros.graph.nodes import FUSION
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.params import config_of
from panoptic_ros.refinement.config import RefinementConfig
from panoptic_ros.running.plans.parameters import Parameters
from panoptic_ros.running.studies.body_poses import body_summary, both_at
from panoptic_ros.running.studies.detected import Detected, detected
from panoptic_ros.stage import Progress

Array = np.ndarray
FEW = 2  # views
WITHOUT, WITH = "without bodies", "with bodies"
CORNERS = ("lShoulder", "rShoulder", "lHip", "rHip")


def study_fill(
    folder: Path,
    cameras: Sequence[str],
    settings: Parameters,
    progress: Progress,
    truth: Path | None = None,
    people: Sequence[int] = (),
) -> dict[str, Any]:
    """How bodies fit images, and errors of `/skeletons` with and without bodies and of bodies, for JSON.

    Args:
        folder: a capture: images, 2D people in detections.json.gz, or the results of a run, whose bag has
            them; with imu.csv and subject*.json, else everybody has a body. cameras: only these; empty = all.
        truth: in place of the folder's own, without which there are no errors.
        people: of the truth, who alone are scored; empty = all.

    Raises:
        UsageError: if the truth that is named is not there, or people are not in it.
    """
    capture = detected(folder, cameras, settings, truth)
    if people:
        capture = replace(capture, truth=_only(capture.truth, people))
    progress(0.4, "solving without bodies")
    plain, _ = _solved(capture, False)
    progress(0.6, "solving with bodies")
    filled, bodies = _solved(capture, True)
    both = both_at(plain, bodies)
    tables = (
        {}
        if capture.truth is None
        else {"rows": _scores(capture, plain, filled), "bodies": _scores(capture, *both)}
    )
    summary = body_summary(capture.context, capture.sets, bodies, both)
    progress(1.0, "scoring")
    return {
        "study": "fill",
        "capture": str(folder),
        "cameras": list(capture.context.rig.names),
        "imus": sum(len(subject.devices) for subject in capture.subjects),
        "summary": summary,
        **tables,
    }


def fill_lines(result: Mapping[str, Any]) -> Iterator[str]:
    """The figures as a table."""
    yield f"{result['capture']}: {len(result['cameras'])} cameras, {result['imus']} IMUs"
    found = result["summary"]
    for key, text in (("px", "px, median"), ("px_90", "px, 90 %"), ("acceleration", "acceleration, m/s^2")):
        yield f"{text:24}{found[key][0]:7.1f} of skeletons{found[key][1]:7.1f} of bodies"
    yield f"{'beyond limits by 5 deg':24}{found['beyond']:7.2%}, most {found['most_deg']:.0f} deg"
    for key, words in (("rows", ("without", "with")), ("bodies", ("skeletons", "bodies"))):
        if key in result:
            yield from _table(result[key], words)


def _table(rows: Sequence[Mapping[str, Any]], words: tuple[str, str]) -> Iterator[str]:
    yield (
        f"{'joints that':24}{'there':>8}{'only ' + words[1]:>13}"
        f"{'mm ' + words[0]:>14}{words[1]:>8}{'less':>7}"
        f"{'offset-free ' + words[0]:>23}{words[1]:>8}{'less':>7}{'mm the better':>15}{'less':>7}"
    )
    for row in rows:
        plain, free, better = row["mm"], row["offset_free_mm"], row["better_mm"]
        yield (
            f"{row['joints']:24}{row['count']:8}{row['only_with']:13}{plain[0]:14.1f}{plain[1]:8.1f}"
            f"{1.0 - plain[1] / plain[0]:7.0%}{free[0]:23.1f}{free[1]:8.1f}{1.0 - free[1] / free[0]:7.0%}"
            f"{better:15.1f}{1.0 - better / plain[0]:7.0%}"
        )


def _only(truth: SkeletonSequence | None, people: Sequence[int]) -> SkeletonSequence:
    """The truth of some people."""
    found = set() if truth is None else {int(i) for frame in truth.frames for i in frame.ids}
    missing = [person for person in people if person not in found]
    if truth is None or missing:
        known = ", ".join(map(str, sorted(found))) or "there is none"
        raise UsageError(f"--person {(missing or people)[0]}: the ids of the truth are {known}")
    frames = []
    for frame in truth.frames:
        rows = np.isin(frame.ids, people)
        frames.append(SkeletonFrame(frame.stamp_ns, frame.ids[rows], frame.positions[rows]))
    return SkeletonSequence(truth.joint_names, tuple(frames))


def _solved(capture: Detected, bodies: bool) -> tuple[list[RefinedPoseSet], list[BodyStateSet]]:
    """`/skeletons` and `/bodies`, by the stages after sync."""
    found: dict[str, list[Any]] = {"skeletons": [], "bodies": []}
    refinement = replace(config_of(capture.configs, RefinementConfig), bodies=bodies)
    pipeline = Pipeline(
        {**capture.configs, "refinement": refinement},
        capture.context,
        (*FUSION, "kinematics") if bodies else FUSION,
        on_record=lambda topic, record: found[topic].append(record) if topic in found else None,
    )
    devices = [device.name for subject in capture.subjects for device in subject.devices]
    samples = imu_samples(capture.imus, devices) if bodies and capture.imus is not None else ()
    for item in merge(samples, capture.sets, key=lambda item: item.stamp_ns):
        pipeline.push("detection_sets" if isinstance(item, DetectionSet) else "imu", item)
    pipeline.flush()
    return found["skeletons"], found["bodies"]


def _pairs(capture: Detected, items: Sequence[TrackedPoseSet]) -> list[FramePair]:
    assert capture.truth is not None
    frames = tuple(SkeletonFrame(i.stamp_ns, i.ids, i.positions, views=i.views) for i in items)
    return pair_sequences(capture.truth, SkeletonSequence(capture.context.skeleton.joint_names, frames))


def _scores(
    capture: Detected, plain: Sequence[TrackedPoseSet], filled: Sequence[TrackedPoseSet]
) -> list[dict[str, Any]]:
    """Of joints by the views that measured them without bodies: errors without and with, mm; and of the
    better one at each joint and instant, which no way to weigh both would go below by much."""
    assert capture.truth is not None
    names = capture.truth.joint_names
    corners = [names.index(name) for name in CORNERS]
    errors: dict[int, list[tuple[Array, Array, Array]]] = {}  # views (J,), of both (J, 3) m, by person
    for one, other in zip(_pairs(capture, plain), _pairs(capture, filled)):
        columns = {match: row for match, row in zip(other.match_ids, other.matches[:, 1].tolist())}
        for match, (t, r) in zip(one.match_ids, one.matches):
            if match not in columns:
                continue
            axes, _ = torso_frames(one.truth[t, corners])
            views = np.where(np.isfinite(one.result[r, :, 0]), one.views[r], 0)
            both = one.result[r], other.result[columns[match]]
            errors.setdefault(match[0], []).append(
                (views, (both[0] - one.truth[t]) @ axes, (both[1] - one.truth[t]) @ axes)
            )
    views = np.concatenate([np.array([v for v, _, _ in own]) for own in errors.values()])
    ends = [[np.array([row[k] for row in own]) for own in errors.values()] for k in (1, 2)]
    whole = [np.concatenate(found) for found in ends]
    free = [np.concatenate([own - np.nanmean(own, axis=0) for own in found]) for found in ends]
    common = np.isfinite(whole[0][..., 0]) & np.isfinite(whole[1][..., 0])
    only = np.isfinite(whole[1][..., 0]) & ~np.isfinite(whole[0][..., 0])
    rows = []
    for text, mask in (
        ("3 views and more see", views > FEW),
        ("2 views see", views == FEW),
        ("1 view or none sees", views < FEW),
        ("2 views or fewer see", views <= FEW),
    ):
        if (mask & common).any():
            rows.append(
                {
                    "joints": text,
                    "count": int((mask & common).sum()),
                    "only_with": int((mask & only).sum()),
                    "mm": _means(whole, mask & common),
                    "offset_free_mm": _means(free, mask & common),
                    "better_mm": _better(whole, mask & common),
                }
            )
    return rows


def _means(errors: Sequence[Array], mask: Array) -> list[float]:
    return [float(1e3 * np.linalg.norm(values[mask], axis=-1).mean()) for values in errors]


def _better(errors: Sequence[Array], mask: Array) -> float:
    return float(1e3 * np.min([np.linalg.norm(own[mask], axis=-1) for own in errors], axis=0).mean())
