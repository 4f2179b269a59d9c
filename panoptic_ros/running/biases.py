"""Measures the joint biases of a detector from files of skeletons, and writes the bias table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.evaluation.bias import Benefit, BiasConfig, BiasPass, MeasuredBiases
from panoptic_ros.graph.recording import InMemoryRecording
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
    """Measure the joint biases of a detector and write them to the table `out`.

    Args:
        detector: name of the detector whose joints these are, stored in the file.
        leave_out: ids of people of the truth to exclude from the measurement.

    Returns:
        for each person, the joint errors before and after correction by biases measured on all other people.

    Raises:
        DataError: if no person of the truth is found in the result, or no person with a visible torso.
        UsageError: if a person to leave out is not found, or all people are left out.
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
    recording = InMemoryRecording({"truth": truth.frames, "skeletons": result.frames})
    found = BiasPass(config).run(recording, progress)
    _check_people(found, config.leave_out, truth_path, result_path)
    left = [not word.startswith("right_") for word in words]
    seen = np.isfinite(found.offsets).all(axis=1)
    rows = {words[j]: found.offsets[j] for j in np.flatnonzero(seen & left)}
    if not rows:
        raise DataError(f"no person in {result_path} has both shoulders and both hips")
    basis = f"{found.skeletons} skeletons of {len(found.measured)} people"
    write_bias_table(out, rows, {"detector": detector, "measured_on": basis})
    return found.benefits


def _check_people(
    found: MeasuredBiases, leave_out: tuple[int, ...], truth_path: Path, result_path: Path
) -> None:
    """Check that people were found, that these include all left-out people, and that other people remain.

    Raises:
        DataError: if no person was found.
        UsageError: if a left-out person was not found, or no other person remains.
    """
    if not found.found:
        raise DataError(f"no person in {result_path} is near a person in {truth_path}")
    for person in leave_out:
        if person not in found.found:
            raise UsageError(f"--leave-out {person}: the ids found are {', '.join(map(str, found.found))}")
    if not found.measured:
        raise UsageError("--leave-out leaves no person to measure on")


def _other_side(word: str, words: tuple[str, ...]) -> int:
    """Return the index of the joint on the other side of the body.

    A joint in the middle, or one without a counterpart, maps to its own index.
    """
    for one, other in (("left_", "right_"), ("right_", "left_")):
        if word.startswith(one) and other + word.removeprefix(one) in words:
            return words.index(other + word.removeprefix(one))
    return words.index(word)
