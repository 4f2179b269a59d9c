"""What live stages may meet. As a program: which kernels were not ready when the stages were constructed.

`python live_situations.py '[["chain", [cameras, settings, skeleton]], ["offsets", []], ...]'` prints one JSON
list for each case. A process of its own, forked after the imports, runs each case; what chains take is
simulated in other processes before.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from multiprocessing import get_context
from typing import Any

import numpy as np
from numba.core.dispatcher import Dispatcher

from panoptic_ros.domain import (
    AudioBlock,
    DetectionSet,
    ImuSample,
    Occluders,
    Rig,
    SkeletonModel,
    Timecode,
    VisibilityLimit,
)
from panoptic_ros.graph.build import configure, make_stage, resolve
from panoptic_ros.graph.nodes import FUSION, NODES
from panoptic_ros.graph.pipeline import Pipeline, records_of
from panoptic_ros.io.skeletons import load_skeleton
from panoptic_ros.simulation import NOISY, SKELETON, Ring, SimulatedScene, Timing, simulate
from panoptic_ros.simulation.drawn_maps import MapDrawing, with_drawn_maps
from panoptic_ros.simulation.ltc_channel import ChannelDistortion, play_ltc
from panoptic_ros.simulation.ltc_signal import AudioFaults, timecode_rate
from panoptic_ros.stage import StageContext

WALL = Occluders(np.array([[0.5, -1.0, 0.0], [0.5, 1.0, 0.0], [0.5, 0.0, 2.0]]), np.array([[0, 1, 2]]))
NEAR = VisibilityLimit(np.full((36, 64), 4000, np.uint16))
UNEQUAL = Timing(phase=0.01, stamp_jitter=0.001, drop=0.1)
FED: dict[tuple[int, str], tuple[Rig, list[list[DetectionSet]]]] = {}  # by cameras and skeleton; see `feed`
BAD_LINE = AudioFaults(snr_db=15.0, hum_db=-5.0, dc=0.05, gain_db=3.0, clicks_per_s=8.0, bits=8)


def kernels() -> set[tuple[str, str, str]]:
    """Module, name and types of all kernels that are compiled or loaded."""
    modules = [module for name, module in sys.modules.items() if name.startswith("panoptic_ros.")]
    found = [value for module in modules for value in vars(module).values() if isinstance(value, Dispatcher)]
    return {(f.py_func.__module__, f.py_func.__name__, str(s)) for f in found for s in f.signatures}


def chain(cameras: int, settings: dict[str, dict[str, Any]], skeleton: str) -> set[tuple[str, str, str]]:
    """From 2D people to skeletons."""
    model, configs = load_skeleton(skeleton) if skeleton else SKELETON, configure(settings)
    rig, fed = FED[cameras, skeleton]
    late = set()
    for occluders in (None, WALL):
        context = StageContext(replace(rig, occluders=occluders), model)
        fusion = Pipeline(configs, context, FUSION)
        whole = Pipeline(configs, context, ("sync", *FUSION))
        before = kernels()
        for sets in fed:
            for item in sets:
                fusion.push("detection_sets", item)
            fusion.flush()
            for view in (view for item in sets for view in item.views):
                whole.push("detections", view)
            whole.flush()
        late |= kernels() - before
    return late


def feed(cameras: int, skeleton: str) -> tuple[Rig, list[list[DetectionSet]]]:
    """A rig, and what its cameras may see."""
    scene = SimulatedScene("test", ("walk", "talk", "reach"), Ring(cameras), area=1.8, degradation=NOISY)
    model = load_skeleton(skeleton) if skeleton else SKELETON
    return simulate(scene, 3, 1).rig, list(situations(scene, model))


def situations(scene: SimulatedScene, skeleton: SkeletonModel) -> Iterator[list[DetectionSet]]:
    """Sets without and with maps, depth limits, stamps of their own, gaps, one person, nobody, one view."""
    plain = sets_of(scene, skeleton)
    maps = [with_drawn_maps(item, MapDrawing((256, 144))) for item in plain]
    bare = tuple(
        replace(
            view,
            points=view.points[:0],
            scores=view.scores[:0],
            person_scores=view.person_scores[:0],
            maps=replace(view.maps, persons=0 * view.maps.persons - 1),
        )
        for view in maps[1].views
    )
    yield plain
    yield maps
    yield [limited(item) for item in plain]
    yield [limited(item) for item in maps]
    yield sets_of(replace(scene, timing=UNEQUAL), skeleton)
    yield [with_drawn_maps(item, MapDrawing()) for item in sets_of(replace(scene, timing=UNEQUAL), skeleton)]
    yield sets_of(replace(scene, activities=("walk",)), skeleton)
    yield [maps[0], replace(maps[1], views=bare), *maps[2:]]  # maps with nobody
    yield [replace(item, views=item.views[:1]) for item in plain]
    yield [plain[0], *(replace(item, views=()) for item in plain[1:])]


def sets_of(scene: SimulatedScene, skeleton: SkeletonModel) -> list[DetectionSet]:
    """A few sets of a scene; joints that the simulation lacks are taken from others."""
    joints = np.arange(len(skeleton)) % len(SKELETON)
    frames = 5 if scene.rig.cameras < 20 else 3
    return [
        replace(
            item,
            views=tuple(
                replace(view, points=view.points[:, joints], scores=view.scores[:, joints])
                for view in item.views
            ),
        )
        for item in simulate(scene, 3, frames).detection_sets(skeleton.hash)
    ]


def limited(item: DetectionSet) -> DetectionSet:
    """The set with views that see 4 m far."""
    return replace(item, views=tuple(replace(view, limit=NEAR) for view in item.views))


def passed(stages: list[Any], items: list[Any]) -> list[Any]:
    """What comes out of the last stage."""
    for stage in stages:
        results = [stage.step(item) for item in items] + [stage.flush()]
        items = [output for result in results for output in result.outputs]
    return items


def offsets() -> set[tuple[str, str, str]]:
    """Clocks from motion, of more cameras than let every frame be used; every other clock is wrong."""
    take = simulate(SimulatedScene("test", ("walk", "talk"), Ring(12), area=1.8), 3, 80)
    context = StageContext(take.rig, SKELETON)
    configs = configure({"offsets": {"active": True, "block_s": 1.0}})
    sets = list(take.detection_sets())
    people = records_of("skeletons_raw", sets, configs, context)
    stage = make_stage("offsets", configs["offsets"], context)
    before, models = kernels(), 0
    for item, found in zip(sets, people, strict=True):
        delays = 20_000_000 * (np.arange(len(item.views)) % 2)
        wrong = [replace(view, stamp_ns=view.stamp_ns + int(d)) for view, d in zip(item.views, delays)]
        results = [stage.step(received) for received in (*wrong, found)]
        models += sum(len(result.outputs) for result in results)
    assert models, "no block was closed"
    return kernels() - before


def continuous() -> set[tuple[str, str, str]]:
    """Free-running cameras: people who come, go and return, odd stamps, a clock that is known later."""
    from free_cameras import FreeCapture
    from stage_cases import cases

    found: set[tuple[str, str, str]] = set()
    captures = [
        FreeCapture(seconds=3.0, there=lambda person, time: person == 0 or not 1.2 < time < 2.0),
        FreeCapture(cameras=2, rate=60.0, seconds=1.0, noise_px=2.0),
    ]
    for capture in captures:
        config = configure({"continuous": {"active": True}})["continuous"]
        stage = make_stage("continuous", config, capture.context)
        before = kernels()
        given = passed([stage], [item.views[0] for item in capture.sets])
        assert any(len(item.ids) for item in given), "nobody was found"
        passed([stage], cases()["continuous"].items if len(capture.rig) > 2 else [])
        found |= kernels() - before
    return found


def timecode() -> set[tuple[str, str, str]]:
    """Sound with all that a line does to it."""
    context = StageContext(simulate(SimulatedScene("test", ("walk",), Ring(2)), 3, 1).rig, SKELETON)
    stages = [make_stage(name, configure({})[name], context) for name in ("timecode", "clocks")]
    before, models = kernels(), 0
    for channel in (
        ChannelDistortion(),
        ChannelDistortion(clip=0.4),
        ChannelDistortion(faults=BAD_LINE),
        ChannelDistortion(low_pass_hz=2500.0),
        ChannelDistortion(high_pass_hz=200.0),
        ChannelDistortion(echo_s=0.3, direct_db=5.0),
        ChannelDistortion(speed=1.1, ramp=0.1),
        ChannelDistortion(wow=0.02, jitter_s=1e-5, inverted=True),
    ):
        for rate, reverse in ((48000, False), (16000, True)):
            start = Timecode.from_frame_count(1000, timecode_rate("30"))
            sound = play_ltc(start, 45, rate, channel, reverse=reverse).samples
            blocks = [
                AudioBlock("mic", 10**9 + first * 10**9 // rate, first, rate, sound[first : first + 1024])
                for first in range(0, len(sound), 1024)
            ]
            models += len(passed(stages, blocks))
    assert models, "nothing was read"
    return kernels() - before


def surface() -> set[tuple[str, str, str]]:
    """Images, 2D tracks and patches, and refinement with what they say; none of somebody, too."""
    import stage_cases

    cases = [stage_cases.cases()[name] for name in ("flow", "patches", "refinement-patches")]
    stages = [case.stage() for case in cases]
    before = kernels()
    for case, stage in zip(cases, stages):
        passed([stage], case.items)
        passed([stage], case.others)
    return kernels() - before


def health() -> set[tuple[str, str, str]]:
    """People who walk, with the 2D poses that they were made from."""
    from stage_cases import cases

    case = cases()["health"]
    stage = case.stage()
    before = kernels()
    for items in (case.items, case.others):
        passed([stage], items)
    return kernels() - before


def bodies() -> set[tuple[str, str, str]]:
    """Somebody with an IMU in views, with one view, by IMUs alone; everybody from skeletons."""
    from stage_cases import cases

    found: set[tuple[str, str, str]] = set()
    for name in ("kinematics", "kinematics-everybody"):
        case = cases()[name]
        one_view = [
            replace(item, views=item.views[:1]) if isinstance(item, DetectionSet) else item
            for item in case.items
        ]
        worn_alone = [item for item in case.items if isinstance(item, ImuSample)]
        stage = case.stage()
        before = kernels()
        given = len(passed([stage], case.items))
        for items in (case.others, one_view, worn_alone):
            passed([stage], items)
        assert given, "nobody was solved for"
        found |= kernels() - before
    return found


def detection() -> set[tuple[str, str, str]]:
    """Images with one person, two, nobody, and strangers; whole, in regions, carried."""
    from stage_cases import watched, watcher  # draws with OpenCV

    from panoptic_ros.detection.config import DetectionConfig
    from panoptic_ros.detection.stage import DetectionStage

    found: set[tuple[str, str, str]] = set()
    for looks in (0.0, 9.0):
        config = DetectionConfig(input_side=256, smallest_input=64, adapt_input=False, looks_per_s=looks)
        stage = DetectionStage(config, watcher())
        before = kernels()
        views = passed([stage], watched())
        assert any(view.maps is not None and (view.maps.persons >= 0).any() for view in views)
        found |= kernels() - before
    return found


PROGRAMS: dict[str, Callable[..., set[tuple[str, str, str]]]] = {
    "chain": chain,
    "offsets": offsets,
    "continuous": continuous,
    "timecode": timecode,
    "surface": surface,
    "health": health,
    "bodies": bodies,
    "detection": detection,
}


def found_late(program: str, arguments: list[Any]) -> list[tuple[str, str, str]]:
    """Kernels that a program of `PROGRAMS` found not ready, sorted."""
    return sorted(PROGRAMS[program](*arguments))


if __name__ == "__main__":
    import stage_cases  # noqa: F401, as children share what is imported here

    for spec in NODES.values():
        resolve(spec.stage)
    assert not kernels(), "importing a module made kernels ready"
    given, fork = json.loads(sys.argv[1]), get_context("fork")
    wanted = list(dict.fromkeys((of[0], of[2]) for program, of in given if program == "chain"))
    with fork.Pool(1) as pool:
        FED.update(zip(wanted, pool.starmap(feed, wanted)))
    assert not kernels(), "records that were simulated elsewhere made kernels ready"
    with fork.Pool(1, maxtasksperchild=1) as pool:
        print(json.dumps(pool.starmap(found_late, given, chunksize=1)))
