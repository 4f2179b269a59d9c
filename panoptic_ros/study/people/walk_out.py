"""The study `walkout`: a person walks out of view; all cameras see the person, then two, then one."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.domain import DetectionSet
from panoptic_ros.errors import UsageError
from panoptic_ros.evaluation import SkeletonFrame, SkeletonSequence, pair_sequences
from panoptic_ros.evaluation.ellipsoids import EllipsoidTally
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.nodes import FUSION
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.io.body_context import body_extras
from panoptic_ros.params import Config
from panoptic_ros.running.plans.parameters import Parameters, read_parameters
from panoptic_ros.simulation import Simulation, simulate
from panoptic_ros.simulation.scenes import scene
from panoptic_ros.simulation.skeleton import JOINTS, SKELETON
from panoptic_ros.stage import Progress, StageContext, each
from panoptic_ros.study.options import add_capture, add_seeds, add_settings
from panoptic_ros.study.people.detected import detected
from panoptic_ros.study.study import Case, Column, Result, Row, Study, grouped, table

SCENE, LEAVING = "walk-out-3p8v", 0  # scene, and index of the person who walks out
EVERY, TWO, ONE = "every view", "two views", "one view"
# s, begin of each phase of the scene; "" = phase that is not scored
SECONDS = ((EVERY, 1.0), (TWO, 3.0), (ONE, 4.5), ("", 6.0))
FEWEST = 3  # lower limit of cameras, of which two are drawn


@dataclass(frozen=True)
class WalkOutTake:
    """2D poses of a take and its ground truth.

    Args:
        phases: phase by timestamp of the set; "" = not scored.
        people: true ids of persons who leave; None = all.
    """

    context: StageContext
    configs: Mapping[str, Config]
    sets: Sequence[DetectionSet]
    phases: Mapping[int, str]
    truth: SkeletonSequence
    people: Collection[int] | None = None


class Walkout(Study):
    """Errors and ellipsoids by phase and by how many views see a joint, over all takes.

    The study also scores bodies if `kinematics.everybody` is set. In a capture, all persons are limited to
    two cameras after a third of the time, and to one of these after two thirds.
    """

    columns = (
        Column("phase", "phase"),
        Column("joints", "joints seen by"),
        Column("given", "given", ".1%"),
        Column("mean_mm", "mean mm", ".1f"),
        Column("p95_mm", "95 % mm", ".1f"),
        Column("in_ellipsoid", "in ellipsoid", ".1%"),
    )

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        add_capture(parser, "capture folder with its truth, instead of simulated people", required=False)
        parser.add_argument(
            "--truth", type=Path, metavar="FILE", help="true skeletons, instead of the capture's own"
        )
        add_seeds(parser, "0")
        add_settings(parser)

    def measure(self, case: Case, progress: Progress) -> Iterator[Row]:
        """See `Study`."""
        given = self.options
        settings, folder = read_parameters(None, given.settings), given.capture
        of_skeletons, of_bodies = ({name: EllipsoidTally() for name in (EVERY, TWO, ONE)} for _ in range(2))
        capture, everybody = None, bool(settings.get("kinematics", {}).get("everybody"))
        if folder is not None:
            capture = detected(folder, given.cameras, settings, given.truth)
            if capture.truth is None:
                raise UsageError(f"{folder} has no truth.json.gz: name a capture folder with its truth")
            if len(capture.context.rig) < FEWEST:
                raise UsageError(
                    f"{len(capture.context.rig)} cameras are too few to leave some out; at least {FEWEST} "
                    "are needed"
                )
        for seed in each(given.seeds, len(given.seeds), progress, "takes"):
            if capture is None:
                take = simulated(simulate(scene(SCENE), seed), settings)
            else:
                assert capture.truth is not None
                context, configs = capture.context, capture.configs
                take = thinned(WalkOutTake(context, configs, capture.sets, {}, capture.truth), seed)
            skeletons, bodies = solved(take, everybody)
            tally(take, skeletons, of_skeletons)
            tally(take, bodies, of_bodies)
        results = {"skeletons": of_skeletons} | ({"bodies": of_bodies} if everybody else {})
        for name, tallies in results.items():
            for phase, own in tallies.items():
                for joints, row in own.rows().items():
                    yield {"of": name, "phase": phase, "joints": joints, **row}

    def lines(self, result: Result) -> Iterator[str]:
        """See `Study`."""
        seeds = ", ".join(map(str, self.options.seeds))
        yield f"{self.options.capture or f'simulated {SCENE}'}, people walk out of the cameras; seeds {seeds}"
        for name, rows in grouped(result["rows"], lambda row: row["of"]).items():
            yield from ("", name, *table(rows, self.columns))


def simulated(take: Simulation, settings: Parameters) -> WalkOutTake:
    """Return a take of the scene with its phases."""
    ticks = take.schedule.ticks
    stamps = [take.master_ns(tick) for tick in ticks]
    begins = [begin for _, begin in SECONDS]
    numbers = np.searchsorted(begins, ticks, "right") - 1
    phases = {stamp: SECONDS[k][0] if k >= 0 else "" for stamp, k in zip(stamps, numbers.tolist())}
    joints = np.stack([person.joints(ticks) for person in take.people], axis=1)
    ids = np.array([person.id for person in take.people])
    frames = tuple(SkeletonFrame(stamp, ids, own) for stamp, own in zip(stamps, joints))
    context = StageContext(take.rig, SKELETON, body_extras(()))
    return WalkOutTake(
        context,
        configure(settings),
        list(take.detection_sets()),
        phases,
        SkeletonSequence(JOINTS, frames),
        (LEAVING,),
    )


def thinned(take: WalkOutTake, seed: int) -> WalkOutTake:
    """Keep two cameras in the second third of a take, and one of these in the last third."""
    names, count = take.context.rig.names, len(take.sets)
    drawn = np.random.default_rng([seed, 81]).choice(len(names), 2, replace=False)
    left = {EVERY: set(names), TWO: {names[k] for k in drawn}, ONE: {names[drawn[0]]}}
    phases, sets = {}, []
    for number, item in enumerate(take.sets):
        phase = list(left)[min(3 * number // count, 2)]
        phases[item.stamp_ns] = phase
        sets.append(
            replace(
                item,
                views=tuple(
                    view
                    if view.camera in left[phase]
                    else replace(
                        view,
                        points=view.points[:0],
                        scores=view.scores[:0],
                        person_scores=view.person_scores[:0],
                        maps=None,
                    )
                    for view in item.views
                ),
            )
        )
    return replace(take, sets=sets, phases=phases)


def solved(take: WalkOutTake, everybody: bool = False) -> tuple[list[SkeletonFrame], list[SkeletonFrame]]:
    """Return `/skeletons` of a take and, if all persons have bodies, the joints of `/bodies`.

    The joints of bodies have the view counts of their skeletons.
    """
    found: dict[str, list[Any]] = {"skeletons": [], "bodies": []}
    pipeline = Pipeline(
        take.configs,
        take.context,
        (*FUSION, "kinematics") if everybody else FUSION,
        on_record=lambda topic, record: found[topic].append(record) if topic in found else None,
    )
    for item in take.sets:
        pipeline.push("detection_sets", item)
    pipeline.flush()
    skeletons = [
        SkeletonFrame(item.stamp_ns, item.ids, item.positions, item.covariances, views=item.views)
        for item in found["skeletons"]
    ]
    views = {(item.stamp_ns, n): row for item in skeletons for n, row in zip(item.ids.tolist(), item.views)}
    bodies = []
    for item in found["bodies"]:
        near = nearest_instant(take, item.stamp_ns)  # bodies have timestamps of their own
        rows = [k for k, n in enumerate(item.ids.tolist()) if (near, n) in views]
        own = np.array([views[near, n] for n in item.ids[rows].tolist()], np.int64)
        points, spreads = item.keypoints[rows], item.keypoint_covariances[rows]
        bodies.append(
            SkeletonFrame(item.stamp_ns, item.ids[rows], points, spreads, views=own.reshape(points.shape[:2]))
        )
    return skeletons, bodies


def nearest_instant(take: WalkOutTake, stamp_ns: int) -> int:
    """Return the timestamp of the set nearest to a timestamp."""
    return min(take.phases, key=lambda stamp: abs(stamp - stamp_ns))


def tally(take: WalkOutTake, frames: Sequence[SkeletonFrame], tallies: Mapping[str, EllipsoidTally]) -> None:
    """Add the results of a take to the tallies of its phases."""
    names = take.context.skeleton.joint_names
    for pair in pair_sequences(take.truth, SkeletonSequence(names, tuple(frames))):
        phase = take.phases[nearest_instant(take, pair.stamp_ns)]
        if phase:
            tallies[phase].take(pair, take.people)
