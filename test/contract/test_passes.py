"""One suite over every pass: what each must do whatever it finds."""

from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest

from panoptic_ros.evaluation import SkeletonFrame
from panoptic_ros.evaluation.bias import BiasConfig, BiasPass
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.clocks_from_motion import motion_clocks
from panoptic_ros.graph.recording import InMemoryRecording
from panoptic_ros.offsets.sound import SoundClocks, SoundClocksConfig
from panoptic_ros.simulation import SKELETON, simulate
from panoptic_ros.simulation.scenes import SCENES
from panoptic_ros.stage import Pass, StageContext, each, part_of, untold
from panoptic_ros.study.timing.sound_rooms import CASES, make_room


class Interrupted(Exception):
    """Somebody wants a pass to end."""


def clocks():
    take = simulate(SCENES["unsync-5v"], 3, 12)
    records = {"detection_sets": list(take.detection_sets())}
    return records, motion_clocks(StageContext(take.rig, SKELETON), configure({}))


def biases():
    rng, names = np.random.default_rng(0), ("lShoulder", "rShoulder", "lHip", "rHip", "Nose")
    body = np.array([[0, 0.2, 1.4], [0, -0.2, 1.4], [0, 0.15, 0.9], [0, -0.15, 0.9], [0.1, 0, 1.6]])
    people = body + np.array([[[0.0, 0.0, 0.0]], [[2.0, 0.0, 0.0]], [[0.0, 2.0, 0.0]]])

    def frames(noise):
        noisy = [people + noise * rng.standard_normal(people.shape) for _ in range(8)]
        return [SkeletonFrame(40_000_000 * i, [3, 4, 7], joints) for i, joints in enumerate(noisy)]

    records = {"truth": frames(0.0), "skeletons": frames(0.02)}
    return records, BiasPass(BiasConfig(names, (0, 1, 2, 3), (1, 0, 3, 2, 4), (4,)))


def sound():
    """Two microphones in one room."""
    heard = make_room(CASES["talker"], 2, 3, 12.0, 20.0)
    records = {("audio", name): list(heard.recording.records("audio", name)) for name in heard.recorders}
    return records, SoundClocks(SoundClocksConfig({name: name for name in heard.recorders}, heard.places))


PASSES = {
    "clocks from motion": clocks,
    "clocks from sound": sound,
    "biases": biases,
}


@lru_cache
def case(name):
    """A recording, the pass over it, what it gives, and how often it tells of its progress."""
    records, work = PASSES[name]()
    recording, told = InMemoryRecording(records), []
    artefact = work.run(recording, lambda share, doing: told.append((share, doing)))
    return recording, work, content(artefact), told


def content(value):
    """Anything that a pass gives or reads, deeply and bit for bit."""
    if isinstance(value, np.ndarray):
        return value.shape, value.dtype.str, value.tobytes()
    if isinstance(value, (tuple, list)):
        return tuple(content(item) for item in value)
    if isinstance(value, dict):
        return tuple((key, content(item)) for key, item in value.items())
    names = [n for cls in type(value).__mro__ for n in getattr(cls, "__slots__", ())]
    names = names or list(getattr(value, "__dataclass_fields__", ()))
    if names:
        return type(value).__name__, tuple((n, content(getattr(value, n))) for n in names)
    return repr(value)


def interrupted_at(call):
    """Progress that interrupts at one of its calls."""
    calls = []

    def progress(share, doing):
        calls.append(share)
        if len(calls) > call:
            raise Interrupted

    return progress


@pytest.mark.parametrize("name", PASSES)
class TestPass:
    def test_gives_the_same_again_and_made_anew(self, name):
        recording, work, expected, _ = case(name)
        assert isinstance(work, Pass)
        assert content(work.run(recording, untold)) == expected
        assert content(PASSES[name]()[1].run(recording, untold)) == expected

    def test_reads_the_recording_without_changing_it(self, name):
        records, work = PASSES[name]()
        before = content(records)
        work.run(InMemoryRecording(records), untold)
        assert content(records) == before

    def test_progress_never_goes_back_and_ends_at_one(self, name):
        _, _, _, told = case(name)
        shares = [share for share, _ in told]
        assert shares == sorted(shares) and 0.0 <= shares[0] and shares[-1] == 1.0
        assert len(shares) > 5 and all(doing for _, doing in told)

    def test_can_be_interrupted_anywhere_and_run_again(self, name):
        recording, work, expected, told = case(name)
        for call in range(0, len(told), max(1, len(told) // 8)):
            with pytest.raises(Interrupted):
                work.run(recording, interrupted_at(call))
        with pytest.raises(Interrupted):
            work.run(recording, interrupted_at(len(told) - 1))
        assert content(work.run(recording, untold)) == expected


class Ask:
    """A record of which only the stamp matters."""

    def __init__(self, stamp_ns):
        self.stamp_ns = stamp_ns


def test_records_are_given_by_topic_scope_and_time_as_often_as_wanted():
    records = [Ask(stamp) for stamp in (3, 5, 5, 9)]
    held = InMemoryRecording({"skeletons": iter(records), ("image", "a"): records[:1]})
    for _ in range(2):
        assert list(held.records("skeletons")) == records
        assert list(held.records("skeletons", begin_ns=5)) == records[1:]
        assert list(held.records("skeletons", begin_ns=5, end_ns=9)) == records[1:3]
        assert list(held.records("skeletons", end_ns=3)) == []
        assert list(held.records("image", "a")) == records[:1]
        assert list(held.records("image")) == list(held.records("image", "b")) == []


@pytest.mark.parametrize("borders", [(0.0, 0.3, 1.0), (0.0, 0.1, 0.7, 0.9, 1.0), np.linspace(0.0, 1.0, 14)])
def test_parts_of_progress_never_go_back_and_end_at_one(borders):
    shares = []
    for begin, end in pairwise(borders):
        part = part_of(lambda share, doing: shares.append(share), begin, end)
        assert list(each(range(7), 7, part, "counting")) == list(range(7))
    assert shares == sorted(shares) and shares[0] == 0.0 and shares[-1] == 1.0
