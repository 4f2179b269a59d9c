"""Open an audio source from a plain description, as in a run's plan.

A recording can be played back in real time, to test a live run without hardware. Microphones and line inputs
are read through PortAudio (the optional package sounddevice).
"""

from __future__ import annotations

import importlib
import queue
import threading
import time
from bisect import bisect_left, insort
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.capture.sound.source import BLOCK_S, SoundSource
from panoptic_ros.capture.sound.video import VideoSound
from panoptic_ros.capture.sound.wav import WavSource
from panoptic_ros.domain import AudioBlock
from panoptic_ros.errors import BackendError, EnvironmentProblem, UsageError, shown

Array = np.ndarray
PATIENCE_S = 0.5
WAITING_BLOCKS = 100  # blocks in the queue; if it is full, new blocks are dropped
SETTLE_S = 1.0
SILENT_S = 5.0  # s without any block after which the device is treated as lost
SECOND = 1_000_000_000
KEPT_S = 5.0  # s, window in which some blocks arrive promptly; a drift of 1e-4 is 0.5 ms in this time
PROMPT = 0.05  # fraction of the blocks with the earliest times, which are discarded as wrong
LOST_NS = SECOND  # ns; a larger delay against the sample count means lost samples or a suspended machine


class MicrophoneSource:
    """Live audio of a device, timestamped by this machine's clock.

    The timestamp of a block is the time of its first sample at the input. PortAudio reports it on the
    stream's own clock, which is compared with this machine's clock. The most prompt blocks are used
    (`BlockStampFilter`), so the scheduling of Python has no effect. In the first second, sound servers are
    wrong by up to 0.4 s, so this second is discarded. Lost samples appear as a gap in the sample count.

    Args:
        device: Name.
        address: PortAudio's device: a part of a name such as "hw:1" or "USB Audio", or a number.
        clocks: Clocks of the channels, see `AudioBlock`.
        clock: Returns ns; clock of the timestamps, by default the wall clock.
        library: Replaces the package in tests.

    Raises:
        EnvironmentProblem: if sounddevice or PortAudio is missing.
        BackendError: if the input does not exist (the existing ones are listed), or cannot be opened.
    """

    def __init__(
        self,
        device: str,
        address: str,
        *,
        clocks: Sequence[str] = (),
        clock: Callable[[], int] = time.time_ns,
        library: Any | None = None,
    ):
        self.device, self.clocks = device, tuple(clocks)
        self._what = f"microphone {device} at {address}"
        self._clock = clock
        self._portaudio = library or _portaudio()
        found = self._query(int(address) if address.isdecimal() else address)
        self.sample_rate, self.channels = int(found["default_samplerate"]), self._count(found)
        self._blocks: queue.Queue[AudioBlock] = queue.Queue(WAITING_BLOCKS)
        self._next, self._unsettled = 0, round(SETTLE_S * self.sample_rate)
        self._stamps = BlockStampFilter(self.sample_rate)
        self._closed = False
        try:
            self._stream = self._portaudio.InputStream(
                device=found["index"],
                channels=self.channels,
                samplerate=self.sample_rate,
                dtype="float32",
                blocksize=int(BLOCK_S * self.sample_rate),
                callback=self._take,
            )
            self._stream.start()
        except self._portaudio.PortAudioError as error:
            raise BackendError(f"{self._what} cannot be opened: {_one_line(error)}") from None

    def __iter__(self) -> Iterator[AudioBlock]:
        waited = 0.0
        while not self._closed:
            try:
                item = self._blocks.get(timeout=PATIENCE_S)
            except queue.Empty:
                waited += PATIENCE_S
                if waited >= SILENT_S and not self._closed:
                    raise BackendError(f"{self._what} gives no more sound") from None
                continue
            waited = 0.0
            yield item

    def close(self) -> None:
        """Close the device; iterations end."""
        if not self._closed:
            self._closed = True
            self._stream.close()

    def __enter__(self) -> MicrophoneSource:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _query(self, address: int | str) -> Any:
        try:
            return self._portaudio.query_devices(address, "input")
        except (ValueError, self._portaudio.PortAudioError):
            inputs = [
                f"{row['index']} {row['name']}"
                for row in self._portaudio.query_devices()
                if row["max_input_channels"]
            ]
            raise BackendError(
                f"{self._what}: no such input; there are {', '.join(inputs) or 'none'}"
            ) from None

    def _count(self, found: Any) -> int:
        """Return the number of channels to open: those with a named clock, or up to two.

        Raises:
            BackendError: if more clocks are named than the device has channels.
        """
        most = int(found["max_input_channels"])
        if len(self.clocks) > most:
            raise BackendError(f"{self._what} has {most} channels; {len(self.clocks)} clocks are named")
        return len(self.clocks) or min(2, most)

    def _take(self, samples: Array, count: int, times: Any, status: Any) -> None:
        """Put a block into the queue; PortAudio calls this in its own thread."""
        if self._unsettled > 0:
            self._unsettled -= count
            return
        ago = self._stream.time - times.inputBufferAdcTime
        now = self._clock()
        if status and status.input_overflow:
            self._next += count  # the amount of the loss is unknown; the gap restarts the decoder
            self._stamps.restart()
        stamp = self._stamps.stamp(self._next, now - round(SECOND * max(0.0, ago)))
        try:
            clean = np.clip(np.nan_to_num(np.array(samples, np.float32)), -1.0, 1.0)
            self._blocks.put_nowait(
                AudioBlock(self.device, stamp, self._next, self.sample_rate, clean, self.clocks)
            )
        except queue.Full:
            pass  # the gap in the sample count shows the loss
        self._next += count


def _portaudio() -> Any:
    """Return the package sounddevice.

    Raises:
        EnvironmentProblem: if it or PortAudio is missing.
    """
    try:
        return importlib.import_module("sounddevice")
    except ImportError:
        raise EnvironmentProblem(
            "microphones need the package sounddevice: pip install sounddevice"
        ) from None
    except OSError:
        raise EnvironmentProblem(
            "microphones need PortAudio: apt install libportaudio2, or the package of your system"
        ) from None


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())


class BlockStampFilter:
    """Filter of block timestamps: they advance with the sample count, referenced to the most prompt blocks.

    A block is reported late, by up to 0.1 s on a busy machine. The blocks that are earliest relative to their
    sample count are therefore right (the minimum filter of network clocks, Mills 1991). A few are too early,
    because sound servers sometimes overestimate their own delay. The filter uses the 5 % quantile instead of
    the minimum.

    Args:
        sample_rate: Hz.
    """

    def __init__(self, sample_rate: int):
        self._rate = sample_rate
        self._starts: deque[tuple[int, int]] = deque()  # (sample, ns of sample 0)
        self._sorted: list[int] = []  # the times of `_starts`, sorted, ns
        self._last = 0

    def stamp(self, first: int, told_ns: int) -> int:
        """Return the timestamp of a block, ns; it always increases.

        Args:
            first: index of its first sample.
            told_ns: time of this sample as reported by the device, ns.
        """
        start = told_ns - first * SECOND // self._rate
        if self._starts and start - self._prompt() >= LOST_NS:
            self.restart()
        self._starts.append((first, start))
        insort(self._sorted, start)
        while self._starts[0][0] < first - KEPT_S * self._rate:
            del self._sorted[bisect_left(self._sorted, self._starts.popleft()[1])]
        self._last = max(self._prompt() + first * SECOND // self._rate, self._last + 1, 0)
        return self._last

    def restart(self) -> None:
        """Forget all blocks after a loss of samples, because the sample count is no longer consistent."""
        self._starts.clear()
        self._sorted.clear()

    def _prompt(self) -> int:
        return self._sorted[int(PROMPT * len(self._sorted))]


def described_sound(kind: str, device: str, clocks: Sequence[str], **more: Any) -> dict[str, Any]:
    """Return a description for `open_sound` as plain values."""
    return {"kind": kind, "device": device, "clocks": list(clocks), **more}


class _TruncatedSource:
    """Source that ends before a given timestamp."""

    def __init__(self, source: SoundSource, until_ns: int):
        self.device, self.clocks = source.device, source.clocks
        self._source, self._until_ns = source, until_ns

    def __iter__(self) -> Iterator[AudioBlock]:
        return takewhile(lambda block: block.stamp_ns < self._until_ns, iter(self._source))

    def close(self) -> None:
        """Close the source."""
        self._source.close()

    def __enter__(self) -> SoundSource:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def open_sound(description: Mapping[str, Any]) -> SoundSource:
    """Open the source of a description: {"kind", "device", "clocks", options of the source}.

    Kinds are wav, video and microphone. A microphone whose address is a WAV file plays it in real time.
    Blocks of a recording with the timestamp "until_ns" and later ones are skipped.

    Raises:
        UserError: as the sources.
    """
    if "until_ns" in description:
        whole = {key: value for key, value in description.items() if key != "until_ns"}
        return _TruncatedSource(open_sound(whole), description["until_ns"])
    given = {key: value for key, value in description.items() if key != "kind"}
    if description["kind"] == "wav":
        return WavSource(**{**given, "path": Path(given["path"])})
    if description["kind"] == "video":
        return VideoSound(**{**given, "path": Path(given["path"])})
    if description["kind"] == "microphone":
        address = str(given.pop("address"))
        if address.lower().endswith(".wav"):
            return SoundPlaybackSource(path=Path(address), **given)
        return MicrophoneSource(address=address, **given)
    raise UsageError(f"sound of {given['device']}: there is no source of kind {shown(description['kind'])}")


class SoundPlaybackSource:
    """WAV file played in real time, timestamped by this machine's clock. It ends with the file.

    Args:
        clocks: Clocks of the channels, see `AudioBlock`.
        clock: Returns ns; clock of the timestamps, by default the wall clock.
        wait: Waits for a number of seconds; returns True if the source was closed meanwhile. For tests.

    Raises:
        DataError: see `WavSource`.
    """

    def __init__(
        self,
        device: str,
        path: Path,
        *,
        clocks: Sequence[str] = (),
        clock: Callable[[], int] = time.time_ns,
        wait: Callable[[float], bool] | None = None,
    ):
        self.device, self.clocks = device, tuple(clocks)
        self._file = WavSource(device, path, clocks=clocks)
        self._closed = threading.Event()
        self._clock, self._wait = clock, wait or self._closed.wait

    def __iter__(self) -> Iterator[AudioBlock]:
        began = self._clock()
        for block in self._file:
            left = began + block.end_ns - self._clock()
            if left > 0 and self._wait(left * 1e-9):
                return
            yield replace(block, stamp_ns=began + block.stamp_ns)

    def close(self) -> None:
        """End running iterations."""
        self._closed.set()

    def __enter__(self) -> SoundPlaybackSource:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
