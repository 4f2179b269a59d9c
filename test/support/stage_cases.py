"""A recording for every stage of the table, and the comparison of what comes out of it, deeply."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache
from typing import Any

import captures
import numpy as np
import patch_scene
import walkers
from blobs import JOINT_MAP, SKELETON, Blobs

from panoptic_ros.detection.model import DetectorModel
from panoptic_ros.domain import (
    AudioBlock,
    BodyStateSet,
    Camera,
    ClockModel,
    DepthFrame,
    DepthSensor,
    EndOfStream,
    ImuSample,
    JointState,
    Rig,
    SubjectSet,
    Timecode,
    TimecodeReading,
    TrackedPoseSet,
    TrackSet,
    ViewAppearance,
    ViewDetections,
    ViewFrame,
    VisibilityLimit,
)
from panoptic_ros.domain.subjects import Device, Subject, TPose
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.graph.build import configure, make_stage
from panoptic_ros.graph.nodes import FUSION
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.pose_prior import read_prior
from panoptic_ros.simulation.ltc_signal import AudioFaults, degrade_audio, encode_ltc, timecode_rate
from panoptic_ros.stage import StageContext
from panoptic_ros.timecode.signal.stream import Buffer

SECOND = 10**9
OTHERS = SubjectSet(SECOND, [3, 7], [[np.nan] * 3, [0.0, 0.0, 1.0]], [-1, SECOND], [-1, 1])
VALUES: dict[str, dict[str, Any]] = {"voting": {"without_maps": True, "parts": True}}  # all that it can do
MEMORY_TO_WORK_IN = {("voting", "_boxes")}  # is emptied, or holds what any stage would


@dataclass(frozen=True)
class Case:
    """One stage under one configuration, a recording for it, and another one that it took before.

    Args:
        name: of the stage.
        values: of its parameters.
    """

    name: str
    values: dict[str, Any]
    items: Sequence[Any]
    others: Sequence[Any]
    context: StageContext = captures.CONTEXT

    def stage(self, context: StageContext | None = None, **values: Any) -> Any:
        configs = configure({self.name: {**self.values, **values}})
        return make_stage(self.name, configs[self.name], context or self.context)


# ---------------------------------------------------------------- recordings


def only(view, rows):
    """A view with some of its people."""
    return replace(
        view, points=view.points[rows], scores=view.scores[rows], person_scores=view.person_scores[rows]
    )


def views(frames=14, start=0, hidden=range(5, 9)):
    """Views of two people, one of whom is hidden for a while."""
    return [
        only(captures.view(camera, i, round((start + i) * SECOND / 30)), [0] if i in hidden else [0, 1])
        for i in range(frames)
        for camera in captures.RIG.cameras
    ]


def with_limits(items):
    """Some views that do not see all of the room."""
    limit = VisibilityLimit.of_depths(np.full((18, 32), 3.0, np.float32), 1.0)
    return [replace(item, limit=limit) if k % 5 == 0 else item for k, item in enumerate(items)]


def clock(camera, shift_ns, until, segment=0):
    covariance = np.diag([1e-8, 1e-12])
    return ClockModel(camera, SECOND, shift_ns, 2e-5, covariance, 0.25, 0, until, 1e-7, segment)


def disturbed():
    """Views in disorder: cameras late and early, clocks that jump back and on, a stamp far off, an end."""
    items = with_limits(views(24))
    items[30] = replace(items[30], stamp_ns=items[30].stamp_ns + 9 * SECOND)
    late = [item for item in items if item.camera == "cam3"]
    moved = [item for item in items if item.camera != "cam3"]
    for k, item in enumerate(late):
        moved.insert(3 * k + 7, item)
    changes = {"cam0": (17, -SECOND // 2), "cam1": (15, 3 * SECOND), "cam3": (20, -SECOND // 5)}
    jumped = [
        replace(item, stamp_ns=item.stamp_ns + changes[item.camera][1])
        if item.camera in changes and item.frame_number > changes[item.camera][0]
        else item
        for item in moved
    ]
    jumped.insert(20, clock("cam0", 1_500_000, SECOND))
    jumped.insert(44, clock("cam0", 1_700_000, SECOND))
    jumped.insert(80, clock("cam1", -3 * SECOND, 5 * SECOND, 1))
    return [*jumped, EndOfStream("cam2")]


TAKEN = {
    "detection_sets": "association",
    "associations": "voting",
    "proposals": "assembly",
    "poses": "tracking",
    "skeletons_raw": "refinement",
}


@cache
def chain(frames=14, start=0):
    """What each stage after detection takes."""
    table = {key: [] for key in (*TAKEN, "tracks")}
    pipeline = Pipeline(
        configure(VALUES),
        captures.CONTEXT,
        ("sync", *FUSION),
        on_record=lambda topic, record: table.setdefault(topic, []).append(record),
    )
    items = views(frames, start)
    for item in items:
        pipeline.push("detections", item)
    pipeline.flush()
    taken = {name: table[topic] for topic, name in TAKEN.items()}
    pairs = zip(taken["association"], table["tracks"])  # what tracking says of a set comes before the next
    fed_back = [item for pair in pairs for item in pair]
    return {**taken, "sync": items, "association": fed_back, "detection_sets": table["detection_sets"]}


def tracked(index, stamp_ns):
    positions = captures.people(stamp_ns / SECOND)
    ones = np.ones(positions.shape[:2])
    return TrackedPoseSet(
        index,
        stamp_ns,
        captures.SKELETON.hash,
        positions,
        np.tile(1e-4 * np.eye(3), (*ones.shape, 1, 1)),
        ones,
        4 * ones,
        JointState.MEASURED * ones,
        np.ones(2),
        ids=np.array([4, 9]),
    )


def motion(start=0, instants=11):
    """Views of cameras whose clocks are off, and tracked people, ten times a second."""
    items = []
    for i in range(start, start + instants):
        stamp = i * SECOND // 10 + SECOND
        for c, camera in enumerate(captures.RIG.cameras):
            seen = captures.view(camera, i, stamp + (c - 1) * 20_000_000)
            items.append(replace(seen, stamp_ns=stamp))
        items.append(tracked(i, stamp))
    return items


def free_views(frames=16, start=0):
    """Views of two people by cameras that expose one after the other."""
    return [
        captures.view(camera, start + i, SECOND + (4 * (start + i) + c) * SECOND // 60)
        for i in range(frames)
        for c, camera in enumerate(captures.RIG.cameras)
    ]


def odd_free_views():
    """The same with a clock model, a stamp far off, one that repeats, a late view, and one without people."""
    items = free_views()
    items[21] = only(items[21], [])
    items[30] = replace(items[30], stamp_ns=items[30].stamp_ns + 9 * SECOND)
    items[35] = replace(items[35], stamp_ns=items[31].stamp_ns)
    items.insert(46, items.pop(41))
    items.insert(25, clock("cam2", 2_000_000, 2 * SECOND))
    return items


def readings(first=1000, devices=("left", "right"), words=44):
    """Two devices, one of which jumps; the timecode jumps, too; another device falls silent."""
    rate, rng = timecode_rate("25"), np.random.default_rng([5, first])
    items = []
    for k in range(words):
        for d, device in enumerate((*devices, "short")):
            if device == "short" and k > 12:
                continue
            stamp = SECOND + d * 777 + k * 40_000_000 + int(20_000 * rng.standard_normal())
            stamp += 400_000_000 if d == 1 and k > 26 else 0
            label = Timecode.from_frame_count(first + k + (50 if k > 36 else 0), rate)
            items.append(TimecodeReading(device, stamp, label, 1920.0 * k, 0.01))
    return items


def named_readings(first=1000, clocks=("A", "B"), words=44):
    """Two timecodes that one recorder hears and one of them another; one jumps, and sound is lost."""
    items, rng = [], np.random.default_rng([5, first])
    for k in range(words):
        for d, (clock, recorder) in enumerate(((clocks[0], "tc"), (clocks[1], "tc"), (clocks[1], "far"))):
            rate = timecode_rate("25" if clock == "A" else "29.97df")
            sample = 48_000 * (k / float(rate.exact) + 0.3 * d) - (4800 if k > 20 else 0)
            label = Timecode.from_frame_count(first + k + (75 if d and k > 34 else 0), rate)
            stamp = SECOND + round(SECOND * k / rate.exact) + int(20_000 * rng.standard_normal())
            items.append(TimecodeReading(recorder, stamp, label, sample, 0.01, False, 0, clock, 48_000))
    return items


def audio(device, words, seed, rate=16_000, block=720, faults=None):
    """Blocks that end inside of words, with noise, and a gap."""
    start = Timecode.from_frame_count(107_880 + seed, timecode_rate("29.97df"))
    signal = encode_ltc(start, words, rate, lead=900.5, tail=300, user_bits=0x1234 + seed)
    samples = degrade_audio(signal.samples, rate, faults or AudioFaults(snr_db=20.0, seed=seed))
    firsts = range(0, len(samples), block)
    gap = len(firsts) * 2 // 3
    return [
        AudioBlock(device, SECOND + first * SECOND // rate, first, rate, samples[first : first + block])
        for k, first in enumerate(firsts)
        if k != gap
    ]


def merged(*streams):
    """Blocks of several devices by turns."""
    rows = [(k / len(stream), item) for stream in streams for k, item in enumerate(stream)]
    return [item for _, item in sorted(rows, key=lambda row: row[0])]


CELLS = np.array([[[10, 10], [12, 20], [14, 30]], [[40, 10], [42, 20], [44, 30]]])


def frames(often="left", rarely="right", count=21):
    """Pictures of two people, of people who are too small for long, and of nobody."""
    places = 4.0 * CELLS + 1.5
    small = places.mean(axis=1, keepdims=True) + 0.35 * (places - places.mean(axis=1, keepdims=True))
    pictures = [
        Blobs.picture((192, 256), what, sigma) for what, sigma in ((places, 4.0), (small, 2.0), ([], 1.0))
    ]
    shown = [0] * 2 + [1] * 16 + [2] * 5
    rows = [(k, often) for k in range(count)] + [(k, rarely) for k in range(0, count, 3)]
    found: list[Any] = []
    for k, camera in sorted(rows):
        frame = replace(Blobs.frame(pictures[shown[k]], k, camera), stamp_ns=SECOND + k * 33_000_000)
        if camera == rarely:
            depth = np.full((24, 32), 2.0 + 0.1 * k, np.float32)
            found.append(DepthFrame(camera, frame.stamp_ns + 3_000_000, k, depth))
        found.append(frame)
    return found


FOCAL, DEPTH = 300.0, 2.0  # px, m: of the cameras that watch, and of those whom they watch


def watching_rig(size=(256, 192), names=("left", "right", "third")):
    """Cameras in one place, so that a pixel is the same place for all of them."""
    matrix = np.array([[FOCAL, 0.0, 127.5], [0.0, FOCAL, 95.5], [0.0, 0.0, 1.0]])
    return Rig(
        tuple(
            Camera(name, size, Intrinsics(matrix, [0.0] * 5), Rigid(np.eye(3), np.zeros(3))) for name in names
        )
    )


def known_people(places, stamp_ns, index=0, unseen=0.0):
    """What tracking says of people with blobs at places (P, 3, 2) px; the fourth joint is their mean."""
    pixels = np.concatenate([places, places.mean(axis=1, keepdims=True)], axis=1)
    people, joints = pixels.shape[:2]
    states = np.zeros((people, joints, 6))
    states[..., :2] = (pixels - (127.5, 95.5)) * DEPTH / FOCAL
    states[..., 2] = DEPTH
    rest = np.zeros((people, joints))
    return TrackSet(
        index,
        stamp_ns,
        SKELETON.hash,
        np.arange(people),
        states,
        np.full((people, joints, 3), 1e-5),
        rest,
        rest,
        np.full(people, unseen),
    )


def watched(cameras=("left", "right"), count=22, start=0):
    """Two people who walk, and what tracking says of them; somebody comes in; a cut; nobody."""
    places = 4.0 * CELLS + 1.5
    found: list[Any] = []
    for k in range(start, start + count):
        here = places + (0.9 * k - 8.0, 0.0)
        shown = np.concatenate([here, here[:1] + (150.0, 90.0)]) if k % 11 in (6, 7, 8, 9) else here
        stamp = SECOND + k * 40_000_000
        for c, camera in enumerate(cameras):
            picture = Blobs.picture((192, 256), shown if k % 17 != 16 else [], 4.0)
            picture = picture if k % 11 != 10 else 255 - picture  # another scene
            found.append(replace(Blobs.frame(picture, k, camera), stamp_ns=stamp + c * 1_000_000))
        if k > start + 1:
            found.append(known_people(here, stamp, k))
    return found


def imu_samples(device, instants, first=0):
    """Of a device that turns slowly; silent for a while, a stamp that stands twice, one far ahead."""
    found = []
    for k in range(first, first + 2 * instants):
        stamp = k * SECOND // 60 + 1_000_000
        angle = 0.01 * k
        turn = [np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)]
        force = [0.1 * np.sin(k), 0.0, 9.81] if k % 7 else [np.nan] * 3
        if not first + 11 <= k < first + 13:
            found.append(ImuSample(device, stamp, turn, [0.0, 0.0, 0.9], force))
    return [*found[:9], found[8], replace(found[9], stamp_ns=9 * SECOND), *found[9:]]


def worn(frames=8, start=0):
    """Sets of 2D people, who is tracked in them, and an IMU on one of them."""
    table = chain(frames, start)
    found = [item for pair in zip(table["detection_sets"], table["refinement"]) for item in pair]
    samples = imu_samples("back", frames, 2 * start)
    for sample in samples:  # those of an instant before its people; one that is far ahead after the fifth
        later = (
            k
            for k, item in enumerate(found)
            if sample.stamp_ns < item.stamp_ns and not isinstance(item, ImuSample)
        )
        end = 10 if sample.stamp_ns == 9 * SECOND else len(found)
        found.insert(next(later, end), sample)
    return found


def wearer():
    """Return the context of a person with id 1 and an IMU, which a T-pose calibrates."""
    model, prior = read_body_model(), read_prior()
    device = Device("back", model.index("spine4"), np.array([-0.1, 0.0, 0.1]), None)
    subject = Subject(1, model.body(1.7), (device,), TPose(0, SECOND // 9, None))
    extras = {"subjects": (subject,), "segments": model, "pose_prior": prior}
    return StageContext(captures.RIG, captures.SKELETON, extras)


def watcher():
    extras = {
        "detector": DetectorModel(Blobs.heads_card(), Blobs.heads_network([-10, -2, 0, 0, 10, 2])),
        "joint_map": JOINT_MAP,
    }
    return StageContext(watching_rig(), SKELETON, extras)


def detector():
    network = Blobs.heads_network([-10, -2, 0, 0, 10, 2])
    extras = {"detector": DetectorModel(Blobs.heads_card(), network), "joint_map": JOINT_MAP}
    return StageContext(Rig(captures.RIG.cameras[:1]), SKELETON, extras)


SENSOR = captures.look_at("depth0", (1.2, 1.5, 1.4), (-0.85, -0.6, 0.9), focal=50.0, size=(60, 60))
SENSED = StageContext(replace(captures.RIG, depth_sensors=(DepthSensor(SENSOR),)), captures.SKELETON)


def sensed(count, start=0):
    """Skeletons, 2D tracks, and maps of a depth sensor before them."""
    found: list[Any] = []
    for item in patch_scene.recording(count, start=start):
        if isinstance(item, TrackedPoseSet):
            found.append(patch_scene.depth_map(SENSOR, item.index, item.positions[0]))
        found.append(item)
    return found


def with_patches(start):
    """What refinement takes where motion is measured on the surface, too."""
    own = make_stage("patches", configure({"patches": {"active": True}})["patches"], captures.CONTEXT)
    found: list[Any] = []
    for item in patch_scene.recording(9, start=start):
        found += own.step(item).outputs
        found += [item] if isinstance(item, TrackedPoseSet) else []
    return found


def with_bodies(frames=8, start=0):
    """What refinement takes where bodies are solved, too."""
    config = configure({"kinematics": {"rate_hz": 15.0, "lag": 0.0, "everybody": True}})["kinematics"]
    own, found = make_stage("kinematics", config, wearer()), []
    for item in chain(frames, start)["refinement"]:
        found += [*own.step(item).outputs, item]
    assert any(len(item.ids) for item in found if isinstance(item, BodyStateSet))
    return found


def walked(camera, count=9, start=0):
    """Images of a pattern that moves, with 2D people on it; one image comes twice, one has nobody known."""
    own, model = np.random.default_rng(3), captures.SKELETON
    wall = own.integers(0, 255, (60, 80, 1), np.uint8).repeat(4, axis=0).repeat(4, axis=1).repeat(3, axis=2)
    points = 120.0 + 40.0 * own.uniform(-1.0, 1.0, (2, len(model), 2))
    found: list[Any] = []
    for k in range(start, start + count):
        image = np.roll(wall, (k, 2 * k), axis=(0, 1))
        frame = ViewFrame(camera, SECOND + k * 40_000_000, k, image)
        found += [frame, frame] if k == start + 3 else [frame]
        if k != start + 5:
            scores = np.full((2, len(model)), 0.9)
            found.append(
                ViewDetections(
                    camera,
                    frame.stamp_ns,
                    k,
                    frame.image_size,
                    model.hash,
                    points + (2.0 * k, k),
                    scores,
                    scores[:, 0],
                )
            )
    return found


def dressed(poses):
    """Skeletons, and before each what the people of its views wear, all but some."""
    found: list[Any] = []
    rng = np.random.default_rng([5, len(poses)])
    for k, item in enumerate(poses):
        for c, (camera, number) in enumerate(zip(item.sources.cameras, item.sources.frames.tolist())):
            if (k + c) % 4:
                colours = rng.normal(0.3, 0.05, (2, 2, 3))
                found.append(ViewAppearance(camera, item.stamp_ns, number, colours))
        found.append(item)
    return found


def small_images():
    """Cameras of the size of those images."""
    rig = watching_rig((320, 240), captures.RIG.names)
    return StageContext(rig, captures.SKELETON)


class Cases(Mapping[str, Case]):
    """Cases by their names, each made when it is first asked for."""

    def __init__(self, makers: dict[str, Callable[[], Case]]):
        self._makers = makers
        self._made: dict[str, Case] = {}

    def __getitem__(self, name: str) -> Case:
        if name not in self._made:
            self._made[name] = self._makers[name]()
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._makers)

    def __len__(self) -> int:
        return len(self._makers)


@cache
def cases():
    ways = {
        "replay": {"window_s": 0.005},
        "live": {"deadline_s": 0.1},
        "grid": {"rate_hz": 29.97, "minimum_views": 2, "queue_limit": 12},
        "interpolated": {"resampling": "interpolate", "clocks": ["cam0=cam0"], "delays_ms": ["cam3=-7.5"]},
    }
    sizes = {"input_side": 0, "smallest_input": 64, "largest_input": 512}
    makers = {
        "timecode": lambda: Case(
            "timecode",
            {},
            merged(audio("mic", 20, 1), audio("line", 16, 2, 48_000, 2500)),
            audio("mic", 12, 7),
        ),
        "clocks": lambda: Case(
            "clocks", {"window_s": 2.0, "period_s": 0.1}, readings(), readings(5000, ("up", "left"))
        ),
        "clocks-named": lambda: Case(
            "clocks",
            {"window_s": 2.0, "period_s": 0.1, "least_span_s": 0.4},
            named_readings(),
            named_readings(5000, ("B", "A")),
        ),
        "detection": lambda: Case(
            "detection", sizes, frames(), frames("right", "third", 12)[::-1], detector()
        ),
        "detection-looks": lambda: Case(
            "detection",
            {**sizes, "looks_per_s": 9.0, "region_height": 64},
            watched(),
            watched(("third", "left"), 9, 50),
            watcher(),
        ),
        "continuous": lambda: Case(
            "continuous", {"active": True, "rate_hz": 20.0}, odd_free_views(), free_views(9, 300)
        ),
        "continuous-subjects": lambda: Case(
            "continuous",
            {"active": True, "rate_hz": 20.0, "subjects": ["7"], "memory": 9.0},
            [*odd_free_views()[:60], OTHERS, *odd_free_views()[60:]],
            free_views(9, 300),
        ),
        "health": lambda: Case("health", {"repair": True}, walkers.walked(), walkers.walk(2, start_s=3.0)),
        "offsets": lambda: Case("offsets", {"active": True, "block_s": 0.5}, motion(), motion(20)),
        **{
            f"sync-{kind}": lambda values=values: Case("sync", values, disturbed(), views(9, start=300)[::-1])
            for kind, values in ways.items()
        },
        **{
            name: lambda name=name: Case(name, VALUES.get(name, {}), chain()[name], chain(7, 200)[name])
            for name in FUSION
        },
        "tracking-subjects": lambda: Case(
            "tracking",
            {"subjects": ["7"]},
            [*chain()["tracking"][:6], OTHERS, *chain()["tracking"][6:]],
            chain(7, 200)["tracking"],
        ),
        "kinematics": lambda: Case(
            "kinematics", {"rate_hz": 40.0, "lag": 0.05}, worn(), worn(7, 200), wearer()
        ),
        "kinematics-everybody": lambda: Case(
            "kinematics",
            {"rate_hz": 15.0, "lag": 0.0, "everybody": True},
            chain()["refinement"],
            chain(7, 200)["refinement"],
            wearer(),
        ),
        "flow": lambda: Case(
            "flow", {}, merged(walked("cam0"), walked("cam1", 5)), walked("cam1", 4, 30), small_images()
        ),
        "appearance": lambda: Case(
            "appearance", {}, merged(walked("cam0"), walked("cam1", 5)), walked("cam1", 4, 30), small_images()
        ),
        "tracking-appearance": lambda: Case(
            "tracking", {"appearance": True}, dressed(chain()["tracking"]), dressed(chain(7, 200)["tracking"])
        ),
        "patches": lambda: Case(
            "patches",
            {"per_part": 4, "life": 4},
            patch_scene.recording(8),
            patch_scene.recording(4, start=90),
        ),
        "patches-depth": lambda: Case(
            "patches", {"per_part": 4, "life": 4}, sensed(8), sensed(4, 90), SENSED
        ),
        "refinement-patches": lambda: Case("refinement", {"lag": 0.08}, with_patches(0), with_patches(90)),
        "refinement-bodies": lambda: Case(
            "refinement", {"bodies": True}, with_bodies(14), with_bodies(7, 200)
        ),
        "refinement-lag": lambda: Case(
            "refinement", {"lag": 0.12}, chain()["refinement"], chain(7, 200)["refinement"]
        ),
    }
    return Cases(makers)


NAMES = (
    "timecode",
    "clocks",
    "clocks-named",
    "detection",
    "detection-looks",
    "continuous",
    "continuous-subjects",
    "health",
    "offsets",
    "sync-replay",
    "sync-live",
    "sync-grid",
    "sync-interpolated",
    *FUSION,
    "tracking-subjects",
    "tracking-appearance",
    "appearance",
    "kinematics",
    "kinematics-everybody",
    "refinement-lag",
    "refinement-patches",
    "refinement-bodies",
    "flow",
    "patches",
    "patches-depth",
)


# ---------------------------------------------------------------- comparing


def content(value: Any, seen: dict[int, tuple[int, Any]] | None = None) -> Any:
    """A value deeply, with types and bits; with `seen`, also what that can change is one and the same."""
    if value is None or isinstance(value, (bool, int, str, bytes, type)):
        return value
    if isinstance(value, (float, np.generic)):
        return type(value).__name__, np.asarray(value).tobytes()
    if seen is not None and can_change(value):
        if id(value) in seen:
            return "again", seen[id(value)][0]
        seen[id(value)] = len(seen), value  # kept: a view that has gone leaves its id to another
    if isinstance(value, np.ndarray):
        return value.shape, value.dtype.str, value.tobytes(), value.flags.writeable, value.flags.c_contiguous
    kind = type(value).__name__
    if isinstance(value, dict):
        return kind, [(content(key, seen), content(each, seen)) for key, each in value.items()]
    if isinstance(value, (set, frozenset)):
        return kind, sorted(map(repr, value))
    if hasattr(value, "__iter__") and hasattr(value, "__len__") and not hasattr(value, "__dict__"):
        return kind, getattr(value, "maxlen", None), [content(each, seen) for each in value]
    if isinstance(value, Buffer):
        return kind, content(value.values, seen)  # its memory is larger, and empty there
    slots = [name for cls in type(value).__mro__ for name in getattr(cls, "__slots__", ())]
    names = {*slots, *getattr(value, "__dict__", {}), *getattr(value, "__dataclass_fields__", {})}
    return kind, [(name, content(getattr(value, name, None), seen)) for name in sorted(names)]


def can_change(value: Any) -> bool:
    if isinstance(value, np.ndarray):
        return value.flags.writeable
    frozen = hasattr(value, "__dataclass_params__") and value.__dataclass_params__.frozen
    return not frozen and not isinstance(value, (tuple, frozenset, Fraction))


def answer(stage: Any, item: Any) -> Any:
    result = stage.step(item)
    return content((result.outputs, result.notices))


def end(stage: Any) -> Any:
    result = stage.flush()
    return content((result.outputs, result.notices))
