"""Measures the joint offsets of a detector in the segment frames of bodies, from files, and writes them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.domain.subjects import BodyState
from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.evaluation import SkeletonFrame, SkeletonSequence
from panoptic_ros.evaluation.bias import Benefit
from panoptic_ros.evaluation.joint_offsets import MatchedSkeletons, judge_joint_offsets, measure_joint_offsets
from panoptic_ros.evaluation.pairing import pairs_in_turn
from panoptic_ros.io.body_files import KINEMATICS, read_bodies
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.compared_skeletons import read_sequence, spelt_alike
from panoptic_ros.io.files import read_json
from panoptic_ros.io.joint_offsets import write_joint_offsets
from panoptic_ros.io.skeletons import in_vocabulary
from panoptic_ros.stage import Progress

Array = np.ndarray
BODIES = "kinematics.json.gz"
NEAR_NS = 30_000_000  # ns, maximum time between a skeleton and the body that provides its segment frames


def write_measured_offsets(
    truth_path: Path,
    result_path: Path,
    out: Path,
    detector: str,
    leave_out: Sequence[int],
    bodies_path: Path | None,
    progress: Progress,
) -> tuple[Benefit, ...]:
    """Measure the joint offsets of a detector and write them to the file `out`.

    Args:
        truth_path: File of bodies (ground truth or our own results), or file of true skeletons.
        result_path: Skeletons from the detector.
        detector: Name of the detector, stored in the file.
        leave_out: Ids of people of the truth to exclude from the measurement.
        bodies_path: Bodies of the result, where the truth holds skeletons; None = the file beside the result.

    Returns:
        for each person, the joint errors before and after correction by offsets measured on all other people.

    Raises:
        UserError: if a file is invalid, no person is found, a left-out person is not found, or all are left
            out.
    """
    model = read_body_model()
    spelling = SkeletonSequence(tuple(model.keypoints), ())
    result = spelt_alike(read_sequence(result_path), spelling)
    document = read_json(truth_path)
    of_bodies = isinstance(document, dict) and document.get("format") == KINEMATICS
    if of_bodies and bodies_path is not None:
        raise UsageError(f"{truth_path} has bodies of its own; leave out --bodies")
    own = truth_path if of_bodies else bodies_path or result_path.parent / BODIES
    if not own.is_file():
        raise UsageError(f"there are no bodies at {own}; name their file with --bodies")
    states = _bodies(own, model)
    progress(0.2, "reading bodies")
    if of_bodies:
        truth = _joints_of(states, model)
    else:
        truth = spelt_alike(read_sequence(truth_path), spelling)
    truth = truth.with_joints([name for name in truth.joint_names if name in result.joint_names])
    people = _posed(truth, result.with_joints(truth.joint_names), states, model, of_bodies)
    if not len(people.ids):
        raise DataError(f"no person in {result_path} is near a person in {truth_path} who has a body")
    found = np.unique(people.ids).tolist()
    for person in leave_out:
        if person not in found:
            raise UsageError(f"--leave-out {person}: the ids found are {', '.join(map(str, found))}")
    kept = people.rows(~np.isin(people.ids, leave_out))
    offsets = measure_joint_offsets(kept, truth.joint_names, model)
    if not offsets:
        raise DataError(f"no joint is in 10 frames of {result_path} and of the people who are not left out")
    progress(0.6, "judging the offsets")
    benefits = judge_joint_offsets(people, truth.joint_names, model)
    words = dict(zip(model.keypoints, in_vocabulary(tuple(model.keypoints))))
    rows = {words[name]: row for name, row in offsets.items() if not words[name].startswith("right_")}
    basis = f"{len(kept.ids)} skeletons of {len(np.unique(kept.ids))} people"
    write_joint_offsets(out, rows, {"detector": detector, "measured_on": basis})
    progress(1.0, "writing")
    return benefits


def _bodies(path: Path, model: SegmentModel) -> dict[int, list[BodyState]]:
    """Return the bodies of a file by id, in time order."""
    names, states = read_bodies(path)
    if names != model.names:
        raise DataError(f"{path} is of another skeleton of segments: {', '.join(names[:4])}, ...")
    found: dict[int, list[BodyState]] = {}
    for state in sorted(states, key=lambda state: state.stamp_ns):
        found.setdefault(state.id, []).append(state)
    return found


def _stature(state: BodyState, model: SegmentModel) -> float:
    """Return the stature, m, that explains the segment lengths of a body."""
    apart = np.linalg.norm(state.places[1:] - state.places[model.parents[1:]], axis=-1)
    return float(np.median(apart / np.linalg.norm(model.shares[1:], axis=-1)))


def _joints_of(states: dict[int, list[BodyState]], model: SegmentModel) -> SkeletonSequence:
    """Return the joints of bodies at their positions in the segment model."""
    segments = np.array([model.index(segment) for segment, _ in model.keypoints.values()])
    shares = np.array([share for _, share in model.keypoints.values()])
    at: dict[int, list[tuple[int, Array]]] = {}
    for own in states.values():
        for state in own:
            arms = state.frames[segments] @ (_stature(state, model) * shares)[..., None]
            at.setdefault(state.stamp_ns, []).append((state.id, state.places[segments] + arms[..., 0]))
    frames = (
        SkeletonFrame(stamp, np.array([i for i, _ in rows]), np.array([joints for _, joints in rows]))
        for stamp, rows in sorted(at.items())
    )
    return SkeletonSequence(tuple(model.keypoints), tuple(frames))


def _posed(
    truth: SkeletonSequence,
    result: SkeletonSequence,
    states: dict[int, list[BodyState]],
    model: SegmentModel,
    of_truth: bool,
) -> MatchedSkeletons:
    """Return all people of the result that match a true person and have a body.

    Args:
        states: bodies by id, in time order.
        of_truth: the bodies have the ids of the truth, otherwise those of the result.
    """
    stamps = {number: np.array([state.stamp_ns for state in own]) for number, own in states.items()}
    rows = []
    for pair in pairs_in_turn(truth, result):
        for ids, (t, r) in zip(pair.match_ids, pair.matches):
            number = ids[0] if of_truth else ids[1]
            if number not in states:
                continue
            nearest = int(np.abs(stamps[number] - pair.stamp_ns).argmin())
            state = states[number][nearest]
            if abs(state.stamp_ns - pair.stamp_ns) <= NEAR_NS:
                rows.append((ids[0], pair.truth[t], pair.result[r], state.frames))
    count, joints, segments = len(rows), len(truth.joint_names), len(model.names)
    columns = [[row[k] for row in rows] for k in range(4)]
    return MatchedSkeletons(
        np.array(columns[0], np.int64),
        np.array(columns[1]).reshape(count, joints, 3),
        np.array(columns[2]).reshape(count, joints, 3),
        np.array(columns[3]).reshape(count, segments, 3, 3),
    )
