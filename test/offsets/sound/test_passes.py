"""Clocks from sound in simulated rooms: within 5 ms and the way of the sound, or not known."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from panoptic_ros.errors import UsageError
from panoptic_ros.graph.recording import InMemoryRecording
from panoptic_ros.offsets.sound import SoundClocks, SoundClocksConfig
from panoptic_ros.stage import untold
from panoptic_ros.study.timing.sound_rooms import CASES, make_room

AIR = 343.0


@lru_cache
def room(name, microphones=3, seed=3, seconds=24.0):
    return make_room(CASES[name], microphones, seed, seconds, snr_db=10.0)


def records_of(heard):
    return {("audio", name): list(heard.recording.records("audio", name)) for name in heard.recorders}


def find(heard, records=None, placed=True, **config):
    devices = {name: name for name in heard.recorders}
    work = SoundClocks(SoundClocksConfig(devices, heard.places if placed else {}, **config))
    return work.run(InMemoryRecording(records or records_of(heard)), untold)


def check(heard, found, base="mic0"):
    """All that is known lies within 5 ms and the way of the sound, and within four stated deviations."""
    clocks = found.clocks
    for c, name in enumerate(clocks.cameras):
        offset, deviation = clocks.offsets[c], clocks.deviations[c]
        if clocks.known[c] and name != base:
            error = abs(offset - heard.offset(name, base, clocks.reference_ns))
            way = np.linalg.norm(heard.places[name] - heard.places[base]) / AIR
            assert error < 0.005 + way and error < 4.0 * deviation
            assert deviation < way + 0.005


@pytest.mark.parametrize("name", ["talker", "talkers", "claps"])
def test_clocks_up_to_a_hundred_seconds_apart_are_found_in_rooms_with_echoes(name):
    heard = room(name)
    found = find(heard, trusted_camera="mic0")
    assert found.clocks.known.all() and not found.unknown and found.placed
    check(heard, found)
    assert found.clocks.offsets[0] == 0.0 == found.clocks.deviations[0]
    assert np.abs(found.clocks.offsets[1:]).min() > 1.0


def test_unknown_positions_are_stated_as_larger_deviations():
    heard = room("talker")
    placed, unplaced = (find(heard, placed=p, trusted_camera="mic0") for p in (True, False))
    check(heard, unplaced)
    assert not unplaced.placed and unplaced.apart_s == pytest.approx(6.0 / AIR)
    assert (
        find(heard, placed=False, trusted_camera="mic0", apart=20.0).clocks.deviations[1:]
        > 2.0 * unplaced.clocks.deviations[1:]
    ).all()
    assert placed.apart_s < unplaced.apart_s


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("other-rooms", "nothing in common"),
        ("other-claps", "few sounds"),
        ("ticks", "repeats"),
        ("loop", "repeats"),
        ("hum", "nothing in common"),
        ("silence", "nothing in common"),
    ],
)
def test_what_has_nothing_in_common_or_repeats_is_not_known_and_says_why(name, why):
    found = find(room(name))
    assert not found.clocks.known.any() and not found.clocks.applied.any()
    assert set(found.unknown) == {"mic0", "mic1", "mic2"} and why in found.unknown["mic0"]


def test_one_camera_in_another_room_is_unknown_alone():
    heard, other = room("talker"), room("talkers", seed=6)
    records = records_of(heard)
    records["audio", "mic2"] = [
        replace(block, device="mic2") for block in other.recording.records("audio", "mic1")
    ]
    found = find(heard, records)
    assert found.clocks.known.tolist() == [True, True, False] and "nothing" in found.unknown["mic2"]
    check(heard, found, base="mic0" if found.clocks.offsets[0] == 0.0 else "mic1")


def test_lost_sound_moves_nothing():
    heard = room("talkers")
    records = records_of(heard)
    records["audio", "mic1"] = [b for k, b in enumerate(records["audio", "mic1"]) if not 10 <= k < 16]
    found = find(heard, records, trusted_camera="mic0")
    assert found.clocks.known.all()
    check(heard, found)


def test_channels_with_timecode_are_left_out_and_a_device_without_others_is_named():
    heard = room("talkers")
    records = records_of(heard)
    noise = np.random.default_rng(0)

    def beside(block, clocks):
        loud = noise.uniform(-1.0, 1.0, block.samples.shape).astype(np.float32)
        return replace(block, samples=np.hstack([loud, block.samples])[:, : len(clocks)], clocks=clocks)

    records["audio", "mic1"] = [beside(b, ("A", "")) for b in records["audio", "mic1"]]
    records["audio", "mic2"] = [beside(b, ("A",)) for b in records["audio", "mic2"]]
    found = find(heard, records, trusted_camera="mic0")
    assert found.clocks.known.tolist() == [True, True, False] and "timecode" in found.unknown["mic2"]
    check(heard, found)


def test_a_device_whose_stamps_leave_its_count_of_samples_is_named():
    heard = room("talkers")
    records = records_of(heard)
    records["audio", "mic2"] = [
        replace(block, stamp_ns=block.stamp_ns + (10**9 if k > 20 else 0))
        for k, block in enumerate(records["audio", "mic2"])
    ]
    found = find(heard, records)
    assert "stray" in found.unknown["mic2"] and found.clocks.known.tolist() == [True, True, False]


def test_the_clock_that_is_farthest_ahead_is_kept_unless_most_agree():
    heard = room("talkers")
    clocks = find(heard).clocks
    assert (clocks.offsets >= 0.0).all() and (clocks.offsets == 0.0).sum() == 1
    records = records_of(heard)
    same = round(1e9 * heard.offset("mic1", "mic0", clocks.reference_ns))
    records["audio", "mic1"] = [replace(b, stamp_ns=b.stamp_ns + same) for b in records["audio", "mic1"]]
    clocks = find(heard, records).clocks
    assert clocks.known.all() and not clocks.applied[:2].any() and clocks.applied[2]


def test_a_trusted_camera_needs_sound():
    with pytest.raises(UsageError, match="mic9"):
        SoundClocks(SoundClocksConfig({"mic0": "mic0", "mic9": ""}, trusted_camera="mic9"))


def test_cameras_share_the_clock_of_the_device_that_hears_for_them():
    heard = room("claps")
    devices = {"left": "mic0", "right": "mic0", "far": "mic1", "deaf": ""}
    found = SoundClocks(SoundClocksConfig(devices)).run(InMemoryRecording(records_of(heard)), untold)
    clocks = found.clocks
    assert clocks.known.tolist() == [True, True, True, False] and found.unknown == {"deaf": "no sound"}
    assert clocks.offsets[0] == clocks.offsets[1] != clocks.offsets[2]
