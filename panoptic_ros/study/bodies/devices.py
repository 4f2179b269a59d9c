"""The study `devices`: IMUs with wrong mounting information: reports, their delay, and the correction.

Each trial puts one fault into a simulated capture: a wrong mounting, two swapped devices, a slipping strap, a
wrong heading of the inertial frame, or none. Any report of another fault is a false alarm.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from panoptic_ros.geometry.rotations import from_quaternions, rotations_of, to_quaternions, vectors_of
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.recorded_motions import read_clips
from panoptic_ros.kinematics.body.tracker import SubjectTracker
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.pose.prior import PoseStatistics
from panoptic_ros.running.kinematics import body_config
from panoptic_ros.running.simulations.body_scenes import body_scene
from panoptic_ros.simulation.bodies.capture import BodyCapture, simulate_body
from panoptic_ros.simulation.bodies.imus import unknown_heading
from panoptic_ros.stage import Progress, each
from panoptic_ros.study.bodies.cases import prior_without
from panoptic_ros.study.bodies.following import follow, tracker_of
from panoptic_ros.study.options import add_seeds, add_settings, known_names, words
from panoptic_ros.study.study import Case, Result, Row, Study

Array = np.ndarray
SCENES = ("body-punch", "body-wash", "body-shake", "body-walk")
# s, limit of the time from a fault to its report, and time after the fault at which the remaining error is
# measured
TOLD_S = 5.0
SLIPS_S = 5.0  # time (s) at which a strap slips
WRONG_DEG, SLIP_DEG, HEADING_DEG = 30.0, 25.0, 10.0
LEFT_DEG = {  # limit of the remaining mounting error: floor of the segment's error, plus 2 degrees
    "hips": 7.0,
    "spine4": 7.0,
    "head": 9.0,
    "UpperArm": 11.0,
    "Forearm": 12.0,
    "Thigh": 6.0,
    "Shin": 6.0,
    "Foot": 14.0,
}
WHOLE = "good, to its end"
KINDS = ("good", WHOLE, "mounting", "swapped", "strap", "heading")
LONGER_S = 60.0  # longer than any capture


class FaultyCapture(NamedTuple):
    """Capture with a fault: the kind, the affected segments, and the begin (s)."""

    capture: BodyCapture
    kind: str
    segments: tuple[str, ...]
    begin_s: float


class Devices(Study):
    """Every kind of fault on every scene with every seed, on the next of the devices.

    The device follows from the seed and the index of the scene.
    """

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        add_seeds(parser, "0")
        parser.add_argument(
            "--scenes",
            type=words,
            default=list(SCENES),
            metavar="NAME,NAME",
            help="scenes of bodies; default all four",
        )
        add_settings(parser, "one parameter of kinematics", "NAME=VALUE")

    def cases(self) -> list[Case]:
        """See `Study`."""
        known_names(self.options.scenes, SCENES, "scene")
        numbered = [(SCENES.index(name), name) for name in self.options.scenes]
        return [
            Case(f"{name} {seed}", (n, name, seed)) for seed in self.options.seeds for n, name in numbered
        ]

    def measure(self, case: Case, progress: Progress) -> Iterator[Row]:
        """See `Study`."""
        model, clips, config = read_body_model(), read_clips(), body_config(settings=self.options.settings)
        n, name, seed = case.request
        whole = body_scene(name)
        scene = replace(whole, seconds=SLIPS_S + TOLD_S + 0.5)
        capture = simulate_body(scene, seed, model, clips)
        statistics = prior_without(scene.clips, clips, model)
        for kind in each(KINDS, len(KINDS), progress, "faults"):
            if kind == WHOLE:
                spoilt = FaultyCapture(simulate_body(whole, seed, model, clips), kind, (), LONGER_S)
            else:
                spoilt = spoil(capture, kind, seed * len(SCENES) + n)
            yield {"scene": name, "seed": seed} | _trial(spoilt, config, statistics)

    def lines(self, result: Result) -> Iterator[str]:
        """Yield the table: trials of each kind, reports in time, remaining errors, and false alarms."""
        yield "simulated, 8 cameras, 13 IMUs; told within 5 s, and degrees left then: median (most)"
        yield (
            f"{'fault':<22}{'trials':>7}{'told':>6}{'after s':>14}{'left':>16}{'in bounds':>11}{'others':>16}"
            "  false alarms"
        )
        for label, rows in _groups(result["rows"]):
            told = [row["told_s"] for row in rows if row["told_s"] is not None]
            kind = rows[0]["kind"]
            left = [row["heading_deg" if kind == "heading" else "left_deg"] for row in rows]
            good = sum(_in_bounds(row) for row in rows)
            others = [np.mean([row[key] for row in rows]) for key in ("others_before_deg", "others_deg")]
            alarms = [text for row in rows for text in row["false"]]
            yield (
                f"{label:<22}{len(rows):>7}{len(told):>6}{_spread(told):>14}{_spread(left):>16}{good:>11}"
                f"{others[0]:>8.1f} > {others[1]:<5.1f}  {len(alarms)} {', '.join(sorted(set(alarms)))}"
            )


def spoil(capture: BodyCapture, kind: str, number: int) -> FaultyCapture:
    """Return the capture with a fault; the number selects the device and the error."""
    rng = np.random.default_rng([number, 7])
    names, worn = capture.subject.body.model.names, list(capture.subject.devices)
    k = number % len(worn)
    axis = rng.normal(size=3)
    turn = rotations_of((axis / np.linalg.norm(axis))[None])[0]
    segment, device = names[worn[k].segment], worn[k].name
    if kind == "mounting":
        mount = worn[k].mount
        assert mount is not None
        worn[k] = replace(worn[k], mount=_powered(turn, WRONG_DEG) @ mount)
        subject = replace(capture.subject, devices=tuple(worn))
        return FaultyCapture(replace(capture, subject=subject), kind, (segment,), 0.0)
    if kind == "swapped":
        by_place = {names[d.segment]: d.name for d in worn}
        limbs = [name[1:] for name in by_place if name[0] == "l" and "r" + name[1:] in by_place]
        segments = ["l" + limbs[number % len(limbs)], "r" + limbs[number % len(limbs)]]
        left, right = (by_place[name] for name in segments)
        samples = {left: capture.devices[right], right: capture.devices[left]}
        there = {left: capture.mounts[right], right: capture.mounts[left]}
        swapped = replace(capture, devices=capture.devices | samples, mounts=capture.mounts | there)
        return FaultyCapture(swapped, kind, tuple(segments), 0.0)
    if kind == "strap":
        series, slip = capture.devices[device], _powered(turn, SLIP_DEG)
        turned = from_quaternions(series.quaternions)
        late = series.stamps >= series.stamps[0] + round(1e9 * SLIPS_S)
        turned[late] = turned[late] @ slip
        forces = series.forces.copy()
        forces[late] = forces[late] @ slip
        slipped = replace(series, quaternions=to_quaternions(turned), forces=forces)
        found = replace(
            capture,
            devices=capture.devices | {device: slipped},
            mounts=capture.mounts | {device: capture.mounts[device] @ slip},
        )
        return FaultyCapture(found, kind, (segment,), SLIPS_S)
    if kind == "heading":
        off = np.radians(HEADING_DEG)
        turned_all = {name: unknown_heading(series, off) for name, series in capture.devices.items()}
        return FaultyCapture(replace(capture, devices=turned_all), kind, (), 0.0)
    return FaultyCapture(capture, kind, (), 0.0)


def _trial(spoilt: FaultyCapture, config: KinematicsConfig, statistics: PoseStatistics) -> dict[str, Any]:
    """Run a trial and return report delay, false alarms, and remaining mounting and heading errors."""
    tracker, instants = tracker_of(spoilt.capture, config, statistics)
    end = instants[0].stamp_ns + round(1e9 * (spoilt.begin_s + TOLD_S))
    used = [instant for instant in instants if instant.stamp_ns <= end]
    names = spoilt.capture.subject.body.model.names
    before = _off(tracker, spoilt)
    told_s, false = None, []
    for instant in follow(tracker, used, config.gate):
        for notice in tracker.devices.take_notices():
            code = notice.code.removeprefix("kinematics.")
            passed = (instant.stamp_ns - instants[0].stamp_ns) * 1e-9 - spoilt.begin_s
            where = next(
                (
                    names[d.segment]
                    for d in spoilt.capture.subject.devices
                    if d.name == notice.values.get("device")
                ),
                "",
            )
            right = code == spoilt.kind and (where in spoilt.segments or not spoilt.segments)
            if right and passed >= 0.0:
                told_s = passed if told_s is None else told_s
            elif not (spoilt.kind in ("mounting", "strap") and where in spoilt.segments):
                false.append(f"{code} {where}".strip())
    after = _off(tracker, spoilt)
    heading = HEADING_DEG * (spoilt.kind == "heading") - float(np.degrees(tracker.mounting.heading))
    kept = [after[n] for n in after if n not in spoilt.segments]
    return {
        "kind": spoilt.kind,
        "segments": list(spoilt.segments),
        "told_s": told_s,
        "false": false,
        "left_deg": max((after[n] for n in spoilt.segments), default=0.0),
        "heading_deg": abs(heading),
        "others_before_deg": float(np.mean([before[n] for n in before if n not in spoilt.segments])),
        "others_deg": float(np.mean(kept)),
    }


def _off(tracker: SubjectTracker, spoilt: FaultyCapture) -> dict[str, float]:
    """Return the mounting error (deg) of each device, by the segment to which the tracker assigns it."""
    found = {}
    capture, worn = spoilt.capture, tracker.devices
    names = capture.subject.body.model.names
    for k, segment in enumerate(worn.segments.tolist()):
        device = worn.names[k]
        corrected = rotations_of(-worn.mounting.mountings[k][None])[0] @ worn.mounts[k]
        apart = vectors_of((corrected @ capture.mounts[device].T)[None])[0]
        found[names[segment]] = float(np.degrees(np.linalg.norm(apart)))
    return found


def _powered(turn: Array, degrees: float) -> Array:
    """Return the rotation by `degrees` about the axis of `turn`, a rotation by 1 rad."""
    found: Array = rotations_of(np.radians(degrees) * vectors_of(turn[None]))[0]
    return found


def _groups(rows: list[dict[str, Any]]) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    for kind in KINDS:
        mine = [row for row in rows if row["kind"] == kind]
        if not mine:
            continue
        yield kind, mine
        places = dict.fromkeys(_place(row) for row in mine if row["segments"])
        for place in sorted(places):
            yield f"  {place}", [row for row in mine if _place(row) == place]


def _place(row: dict[str, Any]) -> str:
    """Return the segment of a fault without its side."""
    name = str(row["segments"][0])
    return name[1:] if name[:1] in "lr" and name[1:2].isupper() else name


def _in_bounds(row: dict[str, Any]) -> bool:
    """Return whether the error that remains after 5 s is below its limit."""
    if row["kind"] == "heading":
        return bool(row["heading_deg"] <= 0.5 * HEADING_DEG)
    if row["kind"] in ("good", WHOLE):
        return bool(row["others_deg"] <= row["others_before_deg"])
    return bool(row["left_deg"] <= LEFT_DEG[_place(row)])


def _spread(values: Sequence[float]) -> str:
    return f"{np.median(values):.1f} ({max(values):.1f})" if len(values) else "-"
