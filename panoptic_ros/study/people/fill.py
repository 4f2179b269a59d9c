"""The study `fill`: fit of bodies and their value for skeletons, by the number of views that see a joint.

It interpolates bodies to the timestamps of skeletons. It measures how well they fit the images, keep joint
limits and hold still.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace
from heapq import merge
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.capture.imus import imu_samples
from panoptic_ros.domain import DetectionSet, JointState, RefinedPoseSet, TrackedPoseSet
from panoptic_ros.domain.bodies import BodyStateSet
from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.errors import UsageError
from panoptic_ros.evaluation import FramePair, SkeletonFrame, SkeletonSequence, pair_sequences
from panoptic_ros.evaluation.capture_report import reprojection_errors, typical_acceleration
from panoptic_ros.geometry.torso import torso_frames
from panoptic_ros.graph.nodes import FUSION
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.params import config_of
from panoptic_ros.refinement.config import RefinementConfig
from panoptic_ros.running.plans.parameters import read_parameters
from panoptic_ros.stage import Progress, StageContext
from panoptic_ros.study.options import add_capture, add_settings
from panoptic_ros.study.people.detected import DetectedCapture, detected
from panoptic_ros.study.study import Case, Column, Result, Row, Study, grouped, table

REACH_NS = 60_000_000  # limit of the time from a skeleton to the bodies before and after it
BEYOND = np.radians(5.0)  # tolerance of joint limits, which are as soft as `limit_sd`
Array = np.ndarray
FEW = 2  # views; joints that at most this number of views sees are reported in a separate row
CORNERS = ("lShoulder", "rShoulder", "lHip", "rHip")


def both_at(
    skeletons: Sequence[TrackedPoseSet], bodies: Sequence[BodyStateSet]
) -> tuple[list[TrackedPoseSet], list[TrackedPoseSet]]:
    """Return the skeletons of persons who have a body, and copies whose joints are those of the bodies."""
    own: dict[int, tuple[list[int], list[Array]]] = {}
    for solved in bodies:
        for number, joints in zip(solved.ids.tolist(), solved.keypoints):
            stamps, found = own.setdefault(number, ([], []))
            stamps.append(solved.stamp_ns)
            found.append(joints)
    plain, posed = [], []
    for item in skeletons:
        placed = {n: _between(*own[n], item.stamp_ns) for n in item.ids.tolist() if n in own}
        rows = [k for k, n in enumerate(item.ids.tolist()) if placed.get(n) is not None]
        plain.append(_chosen(item, rows, item.positions[rows]))
        points = [placed[int(item.ids[k])] for k in rows]
        posed.append(_chosen(item, rows, np.array(points).reshape(len(rows), *item.positions.shape[1:])))
    return plain, posed


def body_summary(
    context: StageContext,
    sets: Sequence[DetectionSet],
    bodies: Sequence[BodyStateSet],
    both: tuple[Sequence[TrackedPoseSet], Sequence[TrackedPoseSet]],
) -> dict[str, Any]:
    """Return the fit of skeletons and of bodies.

    Returns:
        reprojection errors (px, median and 90th percentile) of the joints that skeletons measured;
        accelerations, m/s^2; violations of joint limits, bodies only.
    """
    pixels, accelerations = [], []
    for poses in both:
        errors = reprojection_errors(context.rig, context.skeleton, poses, sets).px
        pixels.append([float(np.percentile(errors, q)) for q in (50, 90)] if len(errors) else [np.nan] * 2)
        found = []
        for number in sorted({n for pose in poses for n in pose.ids.tolist()}):
            there = [(p, p.ids.tolist().index(number)) for p in poses if number in p.ids.tolist()]
            stamps = np.array([p.stamp_ns for p, _ in there])
            found.append(typical_acceleration(stamps, np.array([p.positions[k] for p, k in there])))
        accelerations.append(float(np.nanmean(found)) if found else np.nan)
    return {
        "px": [row[0] for row in pixels],
        "px_90": [row[1] for row in pixels],
        "acceleration": accelerations,
        **_limits(context.extras["segments"], bodies),
    }


def _limits(model: SegmentModel, bodies: Sequence[BodyStateSet]) -> dict[str, float]:
    freedoms = np.concatenate([item.freedoms for item in bodies if len(item.ids)] or [np.zeros((0, 6))])
    if not len(freedoms):
        return {"beyond": float("nan"), "most_deg": float("nan")}
    turns = freedoms[:, 6:].reshape(len(freedoms), -1, 3)
    over = np.maximum(model.lower[1:] - turns, turns - model.upper[1:])
    return {
        "beyond": float((over > BEYOND).mean()),
        "most_deg": float(max(np.degrees(over.max()), 0.0)),
    }


def _between(stamps: Sequence[int], found: Sequence[Array], stamp_ns: int) -> Array | None:
    """Interpolate joints (J, 3) m at a timestamp; None if there is no body near it in time."""
    after = min(int(np.searchsorted(stamps, stamp_ns)), len(stamps) - 1)
    before = max(after - 1, 0) if stamps[after] > stamp_ns else after
    if max(abs(stamps[k] - stamp_ns) for k in (before, after)) > REACH_NS:
        return None
    gap = stamps[after] - stamps[before]
    share = (stamp_ns - stamps[before]) / gap if gap else 0.0
    joints: Array = (1.0 - share) * found[before] + share * found[after]
    return joints


def _chosen(item: TrackedPoseSet, rows: list[int], positions: Array) -> TrackedPoseSet:
    """Return the persons `rows` of a pose set at `positions` (P, J, 3); missing joints stay missing."""
    there = (item.states[rows] != JointState.MISSING) & np.isfinite(positions).all(-1)
    return TrackedPoseSet(
        item.index,
        item.stamp_ns,
        item.skeleton_hash,
        np.where(there[..., None], positions, np.nan),
        np.where(there[..., None, None], item.covariances[rows], np.nan),
        np.where(there, item.scores[rows], 0.0),
        item.views[rows],
        np.where(there, item.states[rows], JointState.MISSING),
        item.person_scores[rows],
        ids=item.ids[rows],
    )


class Fill(Study):
    """How bodies fit images, and errors of `/skeletons` with and without bodies, and of bodies.

    If the capture has no subject*.json, every person has a body.
    """

    columns = (
        Column("joints", "joints that"),
        Column("count", "there"),
        Column("only_with", "only with"),
        *(Column(f"mm_{which}", f"mm {which}", ".1f") for which in ("before", "after")),
        *(Column(f"offset_free_mm_{which}", f"offset-free {which}", ".1f") for which in ("before", "after")),
        Column("better_mm", "mm the better", ".1f"),
    )

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        add_capture(
            parser,
            "images, 2D people in detections.json.gz, or the results of a run; with imu.csv and "
            "subject*.json, else all people get a body",
        )
        parser.add_argument(
            "--truth",
            type=Path,
            metavar="FILE",
            help="true skeletons, instead of the capture's own, which it may lack",
        )
        parser.add_argument(
            "--person",
            type=int,
            metavar="ID",
            action="append",
            default=[],
            help="score only this person of the truth; repeatable",
        )
        add_settings(parser)

    def measure(self, case: Case, progress: Progress) -> list[Row]:
        """See `Study`."""
        given = self.options
        settings = read_parameters(None, given.settings)
        capture = detected(given.capture, given.cameras, settings, given.truth)
        if given.person:
            capture = replace(capture, truth=_only(capture.truth, given.person))
        progress(0.4, "without bodies")
        plain, _ = _solved(capture, False)
        progress(0.6, "with bodies")
        filled, bodies = _solved(capture, True)
        both = both_at(plain, bodies)
        self.about = {
            "capture": str(given.capture),
            "cameras": list(capture.context.rig.names),
            "imus": sum(len(subject.devices) for subject in capture.subjects),
            "summary": body_summary(capture.context, capture.sets, bodies, both),
        }
        if capture.truth is None:
            return []
        rows = [{"table": "skeletons"} | row for row in _scores(capture, plain, filled)]
        return rows + [{"table": "bodies"} | row for row in _scores(capture, *both)]

    def summary(self, rows: list[Row]) -> dict[str, Any]:
        """See `Study`."""
        return self.about

    def lines(self, result: Result) -> Iterator[str]:
        """See `Study`."""
        yield f"{result['capture']}: {len(result['cameras'])} cameras, {result['imus']} IMUs"
        found = result["summary"]
        for key, text in (("px", "px, median"), ("px_90", "px, 90 %"), ("acceleration", "m/s^2")):
            yield f"{text:24}{found[key][0]:7.1f} of skeletons{found[key][1]:7.1f} of bodies"
        yield f"{'beyond limits by 5 deg':24}{found['beyond']:7.2%}, most {found['most_deg']:.0f} deg"
        heads = {
            "skeletons": "before: without bodies, after: with",
            "bodies": "before: skeletons, after: bodies",
        }
        for name, rows in grouped(result["rows"], lambda row: row["table"]).items():
            yield from ("", heads[name], *table(rows, self.columns))


def _only(truth: SkeletonSequence | None, people: Sequence[int]) -> SkeletonSequence:
    """Return the ground truth of some persons."""
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


def _solved(capture: DetectedCapture, bodies: bool) -> tuple[list[RefinedPoseSet], list[BodyStateSet]]:
    """Return `/skeletons` and `/bodies` from the stages after sync."""
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


def _pairs(capture: DetectedCapture, items: Sequence[TrackedPoseSet]) -> list[FramePair]:
    assert capture.truth is not None
    frames = tuple(SkeletonFrame(i.stamp_ns, i.ids, i.positions, views=i.views) for i in items)
    return pair_sequences(capture.truth, SkeletonSequence(capture.context.skeleton.joint_names, frames))


def _scores(
    capture: DetectedCapture, plain: Sequence[TrackedPoseSet], filled: Sequence[TrackedPoseSet]
) -> list[dict[str, Any]]:
    """Score joints by the number of views that measured them without bodies.

    Errors (mm) are given without bodies, with bodies, and for the better of both at each joint and time step.
    The latter is about the best that any weighting of both could reach.
    """
    assert capture.truth is not None
    names = capture.truth.joint_names
    corners = [names.index(name) for name in CORNERS]
    errors: dict[int, list[tuple[Array, Array, Array]]] = {}  # by person: views (J,), errors of both (J, 3) m
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
                    **_means("mm", whole, mask & common),
                    **_means("offset_free_mm", free, mask & common),
                    "better_mm": _better(whole, mask & common),
                }
            )
    return rows


def _means(key: str, errors: Sequence[Array], mask: Array) -> dict[str, float]:
    means = [float(1e3 * np.linalg.norm(values[mask], axis=-1).mean()) for values in errors]
    return dict(zip((f"{key}_before", f"{key}_after"), means))


def _better(errors: Sequence[Array], mask: Array) -> float:
    return float(1e3 * np.min([np.linalg.norm(own[mask], axis=-1) for own in errors], axis=0).mean())
