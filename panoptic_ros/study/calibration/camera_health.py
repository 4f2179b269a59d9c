"""The study `camera-health`: cameras that turn by 0.2 degrees or zoom by 1 % while people walk."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from panoptic_ros.domain import Rig
from panoptic_ros.geometry.rotations import vectors_of
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.nodes import FUSION
from panoptic_ros.graph.pipeline import REPAIRED, Pipeline
from panoptic_ros.simulation.degradation import MILD
from panoptic_ros.simulation.moved_cameras import CameraEvent, DetectorBias, moved_camera_sets
from panoptic_ros.simulation.rigs import Corners, Ring
from panoptic_ros.simulation.scenes import SimulatedScene
from panoptic_ros.simulation.simulate import simulate
from panoptic_ros.simulation.skeleton import SKELETON
from panoptic_ros.simulation.timing import Timing
from panoptic_ros.stage import Notice, Progress, StageContext
from panoptic_ros.study.options import add_seeds, known_names, words
from panoptic_ros.study.study import Case, Column, Result, Row, Study

RATE = 10.0  # Hz; the stage uses ten sets a second at most
BEFORE_S = (18.0, 22.0)  # range of the time of the event
AFTER_S = 16.0  # s after the event in which a camera can be named and repaired
SOON_S = 6.0  # limit of the delay
BIAS = 0.015  # m
TURN, ZOOM = np.deg2rad(0.2), 0.01
CODES = ("health.turned", "health.zoomed")


@dataclass(frozen=True)
class HealthScene:
    """Cameras, what people do, and whether the bias of the detector turns with them."""

    cameras: int
    activities: tuple[str, ...]
    turning: bool = True


CASES = {
    "4x2": HealthScene(4, ("walk", "walk")),
    "4x2-constant": HealthScene(4, ("walk", "walk"), turning=False),
    "5x1": HealthScene(5, ("walk",)),
    "5x2": HealthScene(5, ("walk", "walk")),
    "5x4": HealthScene(5, ("walk", "talk", "sit", "walk")),
    "8x2": HealthScene(8, ("walk", "walk")),
    "5-seated": HealthScene(5, ("sit", "talk", "sit")),
}
EVENTS = ("tilt", "any", "roll", "zoom", "none")


@dataclass
class HealthRun:
    """Reports of the graph about the cameras: notices with their times (s), and the corrected rig."""

    told: list[tuple[float, Notice]] = field(default_factory=list)
    rig: Rig | None = None
    spent: dict[str, float] = field(default_factory=dict)  # s by stage


class CameraHealth(Study):
    """Delay until a changed camera is named, false alarms, and the error of the correction."""

    columns = (
        Column("case", "case"),
        Column("event", "event"),
        Column("named", "named", ".0%"),
        Column("soon", "in 6 s", ".0%"),
        Column("delay_s", "delay s", ".1f"),
        Column("wrong", "wrong", ".0%"),
        Column("false", "false / 10 min", ".2f"),
        Column("error_rad", "left deg", ".3f", 180.0 / np.pi),
        Column("error_focal", "left focal", ".2%"),
        Column("share", "share of time", ".1%"),
    )
    over = ("case", "event")

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        for name, known in (("cases", list(CASES)), ("events", list(EVENTS))):
            parser.add_argument(
                f"--{name}",
                type=words,
                default=known,
                metavar="NAME,NAME",
                help=f"{name}; default {','.join(known)}",
            )
        parser.add_argument("--quiet-s", type=float, default=60.0, help="s without event; default 60")
        add_seeds(parser, "0:4")

    def cases(self) -> list[Case]:
        """See `Study`."""
        return [
            Case(f"{name}, {event}, seed {seed}", (name, event, seed))
            for name in known_names(self.options.cases, CASES, "case")
            for event in known_names(self.options.events, EVENTS, "event")
            for seed in self.options.seeds
        ]

    def measure(self, case: Case, progress: Progress) -> Iterator[Row]:
        """See `Study`."""
        name, kind, seed = case.request
        scene = CASES[name]
        event = None if kind == "none" else draw_event(kind, scene.cameras, seed)
        seconds = self.options.quiet_s if event is None else event.time_s + AFTER_S
        run, rig = watched(scene, seed, seconds, event)
        yield {"case": name, "event": kind, "seed": seed, **figures(run, rig, event, seconds)}

    def head(self, result: Result) -> str:
        """See `Study`."""
        return (
            "People walk before cameras that turn by 0.2 deg, or zoom by 1 %. Axes: any, in the image plane "
            "(tilt), or the optical axis (roll).\n"
            "Detector: mild faults, and a bias of 15 mm per view and joint.\n"
            "False: alarms without an event, over all cameras. Left: error of the corrected camera.\n"
            "Share of time: of the health stage in all stages after sync, at 10 sets per second."
        )


def draw_event(kind: str, cameras: int, seed: int) -> CameraEvent:
    """Return the event of a seed; successive seeds change successive cameras."""
    rng = np.random.default_rng([seed, 5])
    when = float(rng.uniform(*BEFORE_S))
    if kind == "zoom":
        return CameraEvent(when, seed % cameras, zoom=float(1.0 + ZOOM * rng.choice([-1.0, 1.0])))
    x, y, z = rng.standard_normal(3)
    if kind == "tilt":
        z = 0.0
    elif kind == "roll":
        x = y = 0.0
    length = TURN / float(np.sqrt(x * x + y * y + z * z))
    return CameraEvent(when, seed % cameras, turn=(x * length, y * length, z * length))


def watched(
    scene: HealthScene, seed: int, seconds: float, event: CameraEvent | None
) -> tuple[HealthRun, Rig]:
    """Run the stages after sync, with repair, over a simulated take; return also the calibrated rig."""
    plan = Corners(scene.cameras) if scene.cameras <= 5 else Ring(scene.cameras)
    setting = SimulatedScene(
        "camera health",
        scene.activities,
        plan,
        degradation=MILD,
        timing=Timing(rate=RATE),
        frames=round(RATE * seconds),
    )
    take = simulate(setting, seed)
    bias = DetectorBias(seed, scene.cameras, len(scene.activities), BIAS, scene.turning)
    run, now = HealthRun(), [0.0]

    def record(topic: str, item: Any) -> None:
        if topic == REPAIRED:
            run.rig = item

    def spend(stage: str, ns: int) -> None:
        run.spent[stage] = run.spent.get(stage, 0.0) + 1e-9 * ns

    pipeline = Pipeline(
        configure({"health": {"repair": True}}),
        StageContext(take.rig, SKELETON),
        (*FUSION, "health"),
        on_record=record,
        on_notice=lambda stage, notice: run.told.append((now[0], notice)) if notice.code in CODES else None,
        on_step=spend,
        clock=time.perf_counter_ns,
    )
    for item in moved_camera_sets(take, bias, event):
        now[0] = 1e-9 * item.stamp_ns
        pipeline.push("detection_sets", item)
    return run, take.rig


def figures(run: HealthRun, rig: Rig, event: CameraEvent | None, seconds: float) -> Row:
    """Return the figures of a run."""
    share = run.spent["health"] / sum(run.spent.values())
    if event is None:
        return {"false": 600.0 / seconds * len(run.told), "share": share}
    false = sum(when < event.time_s for when, _ in run.told)
    after = [(when - event.time_s, notice) for when, notice in run.told if when >= event.time_s]
    name = rig.names[event.camera]
    own = [delay for delay, notice in after if notice.values["device"] == name]
    code = CODES[event.zoom != 1.0]
    kinds = [notice.code for _, notice in after if notice.values["device"] == name]
    row: Row = {
        "named": float(bool(own)),
        "soon": float(bool(own) and own[0] <= SOON_S),
        "wrong": float(len(own) < len(after) or kinds[:1] not in ([], [code])),
        "false": 600.0 / event.time_s * false,
        "share": share,
    }
    if own and run.rig is not None:
        true, found = event.applied(rig.camera(name)), run.rig.camera(name)
        left = found.cam_from_world.rotation @ true.cam_from_world.rotation.T
        row["delay_s"] = own[0]
        row["error_rad"] = float(np.linalg.norm(vectors_of(np.ascontiguousarray(left[None]))[0]))
        row["error_focal"] = float(abs(found.intrinsics.matrix[0, 0] / true.intrinsics.matrix[0, 0] - 1.0))
    return row
