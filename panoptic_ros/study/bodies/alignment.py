"""The study `alignment`: estimate injected heading and clock offsets of IMUs from seconds of motion.

The study also estimates the segment lengths of bodies.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from panoptic_ros.domain.subjects import ImuSeries
from panoptic_ros.evaluation.kinematic_scores import score_bodies
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.imus.alignment import DeviceSignals, align, cameras_alone, felt_of
from panoptic_ros.running.kinematics import body_config
from panoptic_ros.simulation.bodies.imus import unknown_heading
from panoptic_ros.stage import Progress, each
from panoptic_ros.study.bodies.cases import SKIPPED_S, BodyCase, BodyStudy
from panoptic_ros.study.study import Case, Result, Row

Array = np.ndarray
INPUTS = ((8, 13), (4, 6))  # cameras, IMUs
WINDOWS_S = (5.0, 9.0)
LONGEST_OFFSET_S = 0.1
RATE_HZ = 60.0
# s of motion for the estimate of lengths, and lower limit of the scored time after it
LEARNT_S, SCORED_S = 10.0, 2.0
LENGTHS = ("true", "learnt", "stature")


class Alignment(BodyStudy):
    """A row for each stretch of motion, half of which overlaps with the next: errors, deg and ms.

    A row for each capture: errors with lengths learnt from motion.
    """

    def measure(self, case: Case, progress: Progress) -> Iterator[Row]:
        """See `Study`."""
        capture, whole = self.capture(case), body_config(settings=self.options.settings)
        config = cameras_alone(whole)
        for cameras, imus in each(INPUTS, len(INPUTS), progress, "cameras and IMUs"):
            part = capture.with_inputs(cameras, imus)
            bare = tuple(replace(subject, devices=()) for subject in part.subjects)
            seen = replace(part, subjects=bare, recording=replace(part.recording, devices={}))
            states = seen.solve(config).states
            kind = {"scene": capture.name, "seed": capture.seed, "cameras": cameras, "imus": imus}
            learnt = lengths_row(part, whole)
            if learnt is not None:
                yield {"of": "lengths"} | kind | learnt
            rng = np.random.default_rng([capture.seed, 5])
            for length in WINDOWS_S:
                begin = states[0].stamp_ns + round(1e9 * SKIPPED_S)
                while begin + round(1e9 * length) <= states[-1].stamp_ns:
                    stretch = [s for s in states if begin <= s.stamp_ns <= begin + round(1e9 * length)]
                    yield {"of": "clocks"} | kind | {"seconds": length} | _found(part, stretch, rng)
                    begin += round(5e8 * length)

    def lines(self, result: Result) -> Iterator[str]:
        """Yield the table: root mean square (maximum) over all windows with an estimate."""
        yield f"{self.head(result)}; heading and clock from stretches of motion, root mean square (most)"
        yield (
            "cameras IMUs  seconds  stretches   found     heading, deg         clock, ms   both, in their sd"
        )
        rows = [row for row in result["rows"] if row["of"] == "clocks"]
        for kind in dict.fromkeys((row["cameras"], row["imus"], row["seconds"]) for row in rows):
            mine = [row for row in rows if (row["cameras"], row["imus"], row["seconds"]) == kind]
            found = [row for row in mine if row["found"]]
            cells = [_cell([row[key] for row in found]) for key in ("deg", "ms")]
            ratio = ", ".join(
                _cell([row[key] / row[f"unsure_{key}"] for row in found]) for key in ("deg", "ms")
            )
            text = f"{kind[0]:7} {kind[1]:4}  {kind[2]:7g}  {len(mine):9}  {len(found):6}"
            yield f"{text}  {cells[0]:>15}   {cells[1]:>15}   {ratio}"
        yield from lengths_lines([row for row in result["rows"] if row["of"] == "lengths"])


def _found(case: BodyCase, states: list[Any], rng: np.random.Generator) -> dict[str, Any]:
    """Draw a heading and a clock offset, estimate them, and return the errors."""
    heading, late = rng.uniform(-np.pi, np.pi), rng.uniform(-LONGEST_OFFSET_S, LONGEST_OFFSET_S)
    subject = replace(case.subjects[0], heading_known=False)
    felt = {}
    for device in subject.devices:
        series = unknown_heading(case.recording.devices[device.name], heading).shifted(round(1e9 * late))
        felt[device.name] = _during(series, states)
    found = align(subject, states, felt)
    if found is None:
        return {"found": False, "deg": float("nan"), "ms": float("nan")}
    off = (found.heading - heading + np.pi) % (2.0 * np.pi) - np.pi
    return {
        "found": True,
        "deg": float(np.degrees(off)),
        "ms": 1e3 * (found.offset + late),
        "unsure_deg": float(np.degrees(found.heading_unsure)),
        "unsure_ms": 1e3 * found.unsure,
    }


def _during(series: ImuSeries, states: list[Any]) -> DeviceSignals:
    """Return the IMU samples in the time span of these bodies."""
    there = (series.stamps >= states[0].stamp_ns) & (series.stamps <= states[-1].stamp_ns)
    parts = (series.stamps, series.quaternions, series.rates, series.forces)
    return felt_of(ImuSeries(*(part[there] for part in parts)), RATE_HZ)


def _cell(values: Sequence[float]) -> str:
    if not len(values):
        return "-"
    return f"{np.sqrt(np.mean(np.square(values))):.2f} ({np.abs(values).max():.1f})"


def lengths_row(case: BodyCase, config: KinematicsConfig) -> dict[str, Any] | None:
    """Return mean errors (mm) after `LEARNT_S` for true, estimated and stature-based lengths.

    None if the capture is too short.
    """
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
    """Yield the table: means over captures with the same inputs, and the cost of estimated lengths."""
    yield f"lengths learnt from {LEARNT_S:g} s of motion: mean errors after that, mm"
    yield "cameras IMUs  captures    true  learnt  stature   learnt, worse by (most)"
    for kind in dict.fromkeys((row["cameras"], row["imus"]) for row in rows):
        mine = [row for row in rows if (row["cameras"], row["imus"]) == kind]
        means = [float(np.mean([row[name] for row in mine])) for name in LENGTHS]
        worse = [row["learnt"] - row["true"] for row in mine]
        text = f"{kind[0]:7} {kind[1]:4}  {len(mine):8}  {means[0]:6.1f}  {means[1]:6.1f}  {means[2]:7.1f}"
        yield f"{text}   {np.mean(worse):.1f} ({max(worse):.1f})"
