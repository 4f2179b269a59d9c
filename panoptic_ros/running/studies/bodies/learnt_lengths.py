"""Lengths of a body learnt from seconds of motion: errors with them on the motion after that."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from panoptic_ros.evaluation.kinematic_scores import score_bodies
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.running.studies.bodies.cases import SKIPPED_S, BodyCase

LEARNT_S, SCORED_S = 10.0, 2.0  # of motion; after it, at least
LENGTHS = ("true", "learnt", "stature")


def lengths_row(case: BodyCase, config: KinematicsConfig) -> dict[str, Any] | None:
    """Mean errors, mm, after those seconds, with the true lengths, with those that they tell, and with those
    of the stature; None if the capture does not go on for long enough."""
    short = case.of_stature()
    end = case.truth[0].stamp_ns + round(1e9 * (SKIPPED_S + LEARNT_S))
    if case.truth[-1].stamp_ns < end + round(1e9 * SCORED_S):
        return None
    views = {
        camera: replace(v, stamps=v.stamps[v.stamps < end], people=v.people[: int((v.stamps < end).sum())])
        for camera, v in short.recording.views.items()
    }
    seen = replace(short, recording=replace(short.recording, views=views))
    offsets = [person.body.offsets for person in seen.solve(config).people]
    learnt = [
        replace(subject, body=replace(subject.body, offsets=found), measured=True)
        for subject, found in zip(short.subjects, offsets)
    ]
    kept = replace(config, lengths=False)
    row = {}
    for name, part in zip(LENGTHS, (case, replace(short, subjects=tuple(learnt)), short)):
        states = part.solve(kept).states
        row[name] = float(
            np.mean(
                [
                    score_bodies(
                        [s for s in case.truth if s.id == subject.id],
                        [s for s in states if s.id == subject.id],
                        case.model.parents,
                        SKIPPED_S + LEARNT_S,
                    )["mm"]
                    for subject in case.subjects
                ]
            )
        )
    return row


def lengths_lines(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    """The table: means over the captures of the same inputs, and the most that learnt lengths cost."""
    yield f"lengths learnt from {LEARNT_S:g} s of motion: mean errors after that, mm"
    yield "cameras IMUs  captures    true  learnt  stature   learnt, worse by (most)"
    for kind in dict.fromkeys((row["cameras"], row["imus"]) for row in rows):
        mine = [row for row in rows if (row["cameras"], row["imus"]) == kind]
        means = [float(np.mean([row[name] for row in mine])) for name in LENGTHS]
        worse = [row["learnt"] - row["true"] for row in mine]
        text = f"{kind[0]:7} {kind[1]:4}  {len(mine):8}  {means[0]:6.1f}  {means[1]:6.1f}  {means[2]:7.1f}"
        yield f"{text}   {np.mean(worse):.1f} ({max(worse):.1f})"
