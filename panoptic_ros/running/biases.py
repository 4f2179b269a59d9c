"""A detector's biases from files of skeletons, and the table of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.evaluation.bias import Benefit, BiasConfig, BiasPass, MeasuredBiases
from panoptic_ros.graph.recording import HeldRecording
from panoptic_ros.io.biases import torso_of, write_bias_table
from panoptic_ros.io.compared_skeletons import read_sequence, spelt_alike
from panoptic_ros.io.skeletons import in_vocabulary
from panoptic_ros.stage import Progress


def write_biases(
    truth_path: Path,
    result_path: Path,
    out: Path,
    detector: str,
    leave_out: Sequence[int],
    progress: Progress,
) -> tuple[Benefit, ...]:
    """Measure and write the table `out`; what it is worth for people whom it was not measured on.

    Args:
        detector: whose joints these are, for the file.
        leave_out: people of the truth on whom nothing is measured.

    Raises:
        DataError: if nobody is found, or nobody whose torso is seen.
        UsageError: if one of those left out is not found, or all are left out.
    """
    truth = read_sequence(truth_path)
    result = spelt_alike(read_sequence(result_path), truth).with_joints(truth.joint_names)
    words = in_vocabulary(truth.joint_names)
    config = BiasConfig(
        truth.joint_names,
        torso_of(truth.joint_names, str(truth_path)),
        tuple(_other_side(word, words) for word in words),
        tuple(leave_out),
    )
    recording = HeldRecording({"truth": truth.frames, "skeletons": result.frames})
    found = BiasPass(config).run(recording, progress)
    _check_people(found, config.leave_out, truth_path, result_path)
    left = [not word.startswith("right_") for word in words]
    seen = np.isfinite(found.offsets).all(axis=1)
    rows = {words[j]: found.offsets[j] for j in np.flatnonzero(seen & left)}
    if not rows:
        raise DataError(f"nobody in {result_path} shows both shoulders and both hips")
    basis = f"{found.skeletons} skeletons of {len(found.measured)} people"
    write_bias_table(out, rows, {"detector": detector, "measured_on": basis})
    return found.benefits


def _check_people(
    found: MeasuredBiases, leave_out: tuple[int, ...], truth_path: Path, result_path: Path
) -> None:
    """Somebody was found, among them all who were left out, and somebody else."""
    if not found.found:
        raise DataError(f"nobody in {result_path} is near anybody in {truth_path}")
    for person in leave_out:
        if person not in found.found:
            raise UsageError(f"--leave-out {person}: the ids found are {', '.join(map(str, found.found))}")
    if not found.measured:
        raise UsageError("--leave-out leaves nobody to measure on")


def _other_side(word: str, words: tuple[str, ...]) -> int:
    """Index of the joint on the other side; its own in the middle or where there is none."""
    for one, other in (("left_", "right_"), ("right_", "left_")):
        if word.startswith(one) and other + word.removeprefix(one) in words:
            return words.index(other + word.removeprefix(one))
    return words.index(word)
