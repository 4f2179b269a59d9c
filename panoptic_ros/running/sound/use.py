"""Decides which sound a run uses for the clocks of its cameras, and checks that this sound determines them.

Sound that provides no camera's clock is ignored. The other sound is decoded before the run begins, until
every clock has a model. So a missing clock is reported at once. The run also learns the rough differences
between the clocks, which it needs to align its streams in time.

Two checks detect channels of a recording with swapped timecodes. The frame rates of a camera and its timecode
have an integer ratio, so cameras at 25 Hz are not on the clock of a 29.97 Hz timecode. And the timestamps of
a camera are close to the times of its own timecode, not to those of the other one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise

from panoptic_ros.clocks.config import ClocksConfig
from panoptic_ros.clocks.timeline import day_ns
from panoptic_ros.domain import AudioBlock, Rig, TimecodeReading
from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.bag_streams import SOUND_KEY
from panoptic_ros.params import Config, config_of, named_words
from panoptic_ros.params.named import ALL
from panoptic_ros.running.sound.hearing import DecodedSound, hear
from panoptic_ros.sync.config import SyncConfig
from panoptic_ros.timecode.config import TimecodeConfig

SAME_RATE = 1e-4  # maximum relative difference between equal frame rates; 29.97 and 30 fps differ by 1e-3
# ns by which sound precedes the frames, so that they do not wait for its clock models
LEAD_NS = 5_000_000_000
WHOLE = 0.02  # relative tolerance of an integer ratio
# ns, minimum amount by which swapped timestamps are closer to the other timecode than to their own
NEARER_NS = 1_000_000_000

Readings = Mapping[tuple[str, str], TimecodeReading]


@dataclass(frozen=True)
class SoundRecorder:
    """Device that records sound.

    Args:
        device: Name of the device.
        clocks: Clocks of its channels, see `AudioBlock`.
        where: Name of the device in messages.
        blocks: Returns its sound from the beginning, any number of times; None: the device is live.
    """

    device: str
    clocks: tuple[str, ...]
    where: str
    blocks: Callable[[], Iterator[AudioBlock]] | None = None

    @property
    def named(self) -> tuple[str, ...]:
        """Return the clocks whose timecode the device records."""
        return tuple(clock for clock in self.clocks if clock not in ("", self.device))


@dataclass(frozen=True)
class ClockPlan:
    """Information about clocks before a run.

    Args:
        configs: Configurations of all stages. Those of sync and clocks name the clocks.
        recorders: Index of the first sample to use, by device whose sound is used.
        shifts: By camera, and for sound by topic: ns added to timestamps. They bring all timestamps roughly
            to master time, and place sound ahead of the frames.
        notices: Lines for the user.
    """

    configs: Mapping[str, Config]
    recorders: Mapping[str, int]
    shifts: Mapping[str, int]
    notices: tuple[str, ...] = ()


def plan_clocks(
    rig: Rig,
    configs: Mapping[str, Config],
    recorders: Sequence[SoundRecorder],
    stamps: Mapping[str, Sequence[int]],
) -> ClockPlan:
    """Select the sound that a run needs, and estimate from it the clocks of the cameras.

    Args:
        recorders: available recorders in order of priority.
        stamps: timestamps of some frames of each camera, ns, at least of the first frame.

    Raises:
        DataError: if the recorders carry clocks of some cameras, but not of all.
        UsageError: if they carry no clock of a camera, and `sync.clocks` names one.
    """
    recorders = [_named_by_parameter(recorder, configs) for recorder in recorders]
    clocks = _clocks_of_cameras(rig, configs)
    carried = {clock: r for r in recorders[::-1] for clock in (r.device, *r.named)}
    if not recorders or not carried.keys() & set(clocks.values()):
        _refuse_unheard_parameters(configs, rig, carried)
        return ClockPlan(configs, {}, {}, tuple(_unused(recorders, rig)))
    _require_carried(clocks, carried)
    used = [r for r in recorders if r.named or r.device in clocks.values()]
    configs = _with_names(configs, clocks, used, carried)
    if any(recorder.blocks is None for recorder in used):
        return ClockPlan(configs, {r.device: 0 for r in used}, {})
    heard = hear(used, configs, set(clocks.values()))
    _require_one_rate(heard)
    _require_heard(clocks, heard, used, config_of(configs, ClocksConfig).master_clock)
    check_swapped(clocks, heard.words, stamps)
    notices = (*_unused([r for r in recorders if r not in used], rig), *_on_no_clock(rig, clocks))
    return ClockPlan(configs, heard.begins, _shifts(clocks, heard, stamps, rig), notices)


def _named_by_parameter(recorder: SoundRecorder, configs: Mapping[str, Config]) -> SoundRecorder:
    given = named_words("TimecodeConfig.channels", config_of(configs, TimecodeConfig).channels)
    if recorder.device not in given:
        return recorder
    return replace(recorder, clocks=tuple(name.strip() for name in given[recorder.device].split(",")))


def _clocks_of_cameras(rig: Rig, configs: Mapping[str, Config]) -> dict[str, str]:
    """Return the clock of every camera that has one, from the parameters of sync or else from the rig."""
    told = named_words("SyncConfig.clocks", config_of(configs, SyncConfig).clocks)
    every = {c.name: told.get(c.name, told.get(ALL, c.clock)) for c in rig.cameras}
    return {name: clock for name, clock in every.items() if clock}


def _with_names(
    configs: Mapping[str, Config],
    clocks: Mapping[str, str],
    used: Sequence[SoundRecorder],
    carried: Mapping[str, SoundRecorder],
) -> dict[str, Config]:
    """Return the configurations, with the cameras' clocks and the master clock set in sync and clocks.

    Raises:
        UsageError: if no channel carries the timecode of the master clock.
    """
    sync, own = config_of(configs, SyncConfig), config_of(configs, ClocksConfig)
    named = [clock for recorder in used for clock in recorder.named]
    master = sync.master_clock or own.master_clock or next(iter(named), "")
    if master and master not in named:
        raise UsageError(
            f"sync.master_clock = {master!r} is the timecode of no channel; named are "
            f"{', '.join(dict.fromkeys(named)) or 'none'}"
        )
    entries = tuple(f"{camera}={clock}" for camera, clock in clocks.items())
    return {
        **configs,
        "sync": replace(sync, clocks=entries, master_clock=master),
        "clocks": replace(own, master_clock=master),
    }


def _refuse_unheard_parameters(
    configs: Mapping[str, Config], rig: Rig, carried: Mapping[str, SoundRecorder]
) -> None:
    told = named_words("SyncConfig.clocks", config_of(configs, SyncConfig).clocks)
    for camera, clock in told.items():
        if clock not in carried and clock not in rig.names:
            there = ", ".join(carried) or "there is no sound"
            raise UsageError(
                f"sync.clocks names {camera}={clock}, but no recording has the timecode of clock {clock}: "
                f"{there}"
            )


def _require_carried(clocks: Mapping[str, str], carried: Mapping[str, SoundRecorder]) -> None:
    for clock in dict.fromkeys(clocks.values()):
        if clock not in carried:
            cameras = ", ".join(camera for camera, own in clocks.items() if own == clock)
            raise DataError(
                f"no recording has the timecode of clock {clock}, which stamps {cameras}: there is sound "
                f"of {', '.join(carried)}; name its channel in sound.yaml, or leave these cameras out"
            )


def _require_one_rate(heard: DecodedSound) -> None:
    """Check that all recorders decode a timecode at the same rate; else they carry different timecodes.

    Raises:
        DataError: if the rates differ.
    """
    rates: dict[str, tuple[str, float]] = {}
    for (device, clock), word in heard.words.items():
        rate = float(word.timecode.rate.exact)
        other, before = rates.setdefault(clock, (device, rate))
        if clock and abs(rate - before) > SAME_RATE * rate:
            raise DataError(
                f"clock {clock} has {before:.5g} fps at {other} and {rate:.5g} fps at {device}: are "
                "channels swapped? Correct sound.yaml"
            )


def _require_heard(
    clocks: Mapping[str, str], heard: DecodedSound, used: Sequence[SoundRecorder], master: str
) -> None:
    for clock in dict.fromkeys(clocks.values()):
        if clock not in heard.models:
            cameras = ", ".join(camera for camera, own in clocks.items() if own == clock)
            what = _what_was_heard(heard, used) + (f" ({heard.notices[0]})" if heard.notices else "")
            lone = _apart(clock, heard, used, master)
            if lone:
                what += f"; no recording has the timecodes of both {lone} and {master}"
            raise DataError(f"there is no timecode of clock {clock}, which stamps {cameras}: {what}")


def _apart(clock: str, heard: DecodedSound, used: Sequence[SoundRecorder], master: str) -> str:
    """Return the decoded timecodes that determine a clock but have no connection to the master clock."""
    connected, before = {master}, set[str]()
    while connected != before:
        before = set(connected)
        for recorder in used:
            connected |= set(recorder.named) if connected & set(recorder.named) else set()
    carried = {own for _, own in heard.words}
    of_clock = {own for r in used if clock in (r.device, *r.named) for own in r.named}
    return ", ".join(sorted((of_clock & carried) - connected))


def _what_was_heard(heard: DecodedSound, used: Sequence[SoundRecorder]) -> str:
    """Return a few words about the decoded sound of every recorder."""
    found = []
    for recorder in used:
        words = [clock or recorder.device for device, clock in heard.words if device == recorder.device]
        what = f"timecode of {', '.join(words)} only" if words else "no timecode"
        found.append(f"{recorder.where} has {what} in {heard.seconds:.0f} s")
    return "; ".join(found)


def _shifts(
    clocks: Mapping[str, str], heard: DecodedSound, stamps: Mapping[str, Sequence[int]], rig: Rig
) -> dict[str, int]:
    """Return the shifts by camera, and for sound by topic, ns.

    Sound that began later than the frames is shifted to precede them as well.
    """
    cameras = {name: heard.models[clocks[name]].offset_ns if name in clocks else 0 for name in rig.names}
    firsts = [stamps[name][0] + shift for name, shift in cameras.items() if stamps.get(name)]
    devices = {}
    for device, first in heard.firsts.items():
        shift = heard.models[device].offset_ns if device in heard.models else 0
        late = max(0, first + shift - min(firsts)) if firsts else 0
        devices[TOPICS[SOUND_KEY].of(device)] = shift - late - LEAD_NS
    return cameras | devices


def _unused(recorders: Sequence[SoundRecorder], rig: Rig) -> Iterator[str]:
    """Yield a line about sound that provides no camera's clock.

    The line mentions --offsets-from-sound if several cameras have sound of their own.
    """
    if not recorders:
        return
    named = ", ".join(dict.fromkeys(camera.clock for camera in rig.cameras if camera.clock)) or "no clocks"
    where = ", ".join(recorder.where for recorder in recorders[:3])
    if len(recorders) > 3:
        where += f" and {len(recorders) - 3} more"
    told = "is not used: it gives" if len(recorders) == 1 else "are not used: they give"
    of_cameras = sum(recorder.device in rig.names for recorder in recorders)
    remedy = "; if the cameras' clocks differ, --offsets-from-sound aligns them by it"
    yield (
        f"{where} {told} no clock of the cameras (the rig names {named}){remedy if of_cameras > 1 else ''}"
    )


def _on_no_clock(rig: Rig, clocks: Mapping[str, str]) -> Iterator[str]:
    others = [name for name in rig.names if name not in clocks]
    if others:
        yield f"stamps of {', '.join(others)} are assumed to be master time, as no clock is named for them"


def check_swapped(clocks: Mapping[str, str], words: Readings, stamps: Mapping[str, Sequence[int]]) -> None:
    """Check that no two channels of one device are swapped. Swapped channels fit each other's cameras only.

    Args:
        clocks: clock by camera.
        words: first timecode reading by device and clock.
        stamps: timestamps of each camera's frames, ns.

    Raises:
        DataError: naming the channels.
    """
    frames: dict[str, Sequence[int]] = {}
    for camera, clock in clocks.items():
        if len(stamps.get(camera, ())) > 1:
            frames.setdefault(clock, stamps[camera])
    for (one, a), (other, b) in combinations(words, 2):
        pair = [frames.get(a, ()), frames.get(b, ())]
        if one == other and all(pair) and _are_swapped(pair, [words[one, a], words[other, b]]):
            raise DataError(
                f"the channels of {one} seem to be swapped: cameras of clock {a} fit the timecode on the "
                f"channel of {b} ({words[other, b].timecode}), and those of {b} that of {a} "
                f"({words[one, a].timecode}); correct sound.yaml"
            )


def _are_swapped(frames: Sequence[Sequence[int]], words: Sequence[TimecodeReading]) -> bool:
    own, others = list(zip(frames, words)), list(zip(frames, words[::-1]))
    if not any(_fits(*pair) for pair in own) and all(_fits(*pair) for pair in others):
        return True
    nearest = min(_away_ns(*pair) for pair in own)
    alike = all(_fits(*pair) for pair in others)
    return alike and max(_away_ns(*pair) for pair in others) + NEARER_NS < nearest


def _fits(stamps: Sequence[int], word: TimecodeReading) -> bool:
    """Return whether the rates of frames and timecode are integer multiples, in either direction."""
    steps = sorted(after - before for before, after in pairwise(stamps))
    ratio = steps[len(steps) // 2] * 1e-9 * float(word.timecode.rate.exact)
    ratio = max(ratio, 1.0 / max(ratio, 1e-9))
    return abs(ratio - round(ratio)) <= WHOLE * ratio


def _away_ns(stamps: Sequence[int], word: TimecodeReading) -> int:
    """Return the time between the first frame and the first decoded timecode, ns."""
    return abs(stamps[0] - day_ns(word.timecode))
