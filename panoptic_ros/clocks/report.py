"""Measure the clock of each camera from its frame timestamps, and report problems with remedies.

Frames are exposed at even intervals. Timestamps of the host are late by a transport delay. The x axis is the
frame count, including dropped frames. The line below the timestamps (`envelope`) is the clock of the camera,
up to a constant that timestamps cannot reveal. The line gives period, drops and jitter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from panoptic_ros.clocks.envelope import fit_lower_line
from panoptic_ros.clocks.line import Line, fit_line
from panoptic_ros.clocks.stage import RATE_OFF
from panoptic_ros.errors import DataError
from panoptic_ros.stage import Notice

LEAST_FRAMES = 8
FOLLOW = 0.1  # gain with which the error of a frame corrects the expected time of the next frame
LATE_RATIO = 2.0  # ratio of the late tail to the early tail above which timestamps are one-way
Array = np.ndarray
SECOND = 1_000_000_000
USUAL_RATES = (  # Hz
    5.0,
    6.0,
    10.0,
    12.0,
    12.5,
    15.0,
    20.0,
    24000 / 1001,
    24.0,
    25.0,
    30000 / 1001,
    30.0,
    48.0,
    50.0,
    60000 / 1001,
    60.0,
    90.0,
    100.0,
    120.0,
    200.0,
    240.0,
)
MANY_LOST = 0.005  # share of dropped frames above which a warning is given
PACED = 0.6  # concentration of timestamps on the host's grid above which the host sets the pace
PACED_JITTER_S = 3e-4  # s; hardware timestamps may lie on a grid too, but scatter less
BEAT = 0.25  # periods, peak-to-peak deviation from an even clock above which a warning is given
SAME_RATE = 8e-4  # maximum relative difference of two equal rates
OUT_OF_PHASE = 0.1  # periods, phase difference above which cameras are reported as out of phase
SMOOTH = 15  # frames, length of the moving average


@dataclass(frozen=True, eq=False)
class FrameTiming:
    """Timing of a camera's frames, from their timestamps.

    Args:
        reference_ns: (ns) timestamp of the first frame.
        rate_hz, rate_std_hz: (Hz) frame rate by the clock that sets the timestamps, with its standard
            deviation.
        counts: (N,) frame number on the camera's even grid; numbers of dropped frames are absent.
        errors_s: (N,) timestamp minus the line.
        interval_std_s: standard deviation of the intervals between timestamps, without drops.
        jitter_s: robust standard deviation of the timestamps about the line.
        lost: (count) missing frames between others.
        gaps: (count) places where frames are missing.
        not_later: (count) timestamps not later than the previous one. All other fields ignore them.
        one_way: True if the late tail of the timestamps is longer than the early one. The line then lies
            below them.
    """

    reference_ns: int
    rate_hz: float
    rate_std_hz: float
    counts: Array
    errors_s: Array
    interval_std_s: float
    jitter_s: float
    lost: int
    gaps: int
    not_later: int
    one_way: bool


def measure_frames(stamps_ns: Sequence[int], numbers: Sequence[int] | None = None) -> FrameTiming:
    """Measure the frame timing of one camera.

    Args:
        stamps_ns: timestamps in order of arrival.
        numbers: frame numbers, if the device counts the frames that it drops. None: derived from the
            timestamps.

    Raises:
        DataError: fewer than 8 frames with increasing timestamps.
    """
    kept = [0] if len(stamps_ns) else []
    for k in range(1, len(stamps_ns)):
        if stamps_ns[k] > stamps_ns[kept[-1]]:
            kept.append(k)
    if len(kept) < LEAST_FRAMES:
        raise DataError(f"{len(kept)} frames with increasing stamps are too few to measure a clock")
    reference = int(stamps_ns[kept[0]])
    times = np.array([(int(stamps_ns[k]) - reference) * 1e-9 for k in kept])
    counts = _count(times)
    if numbers is not None:
        given = np.array([numbers[k] for k in kept]) - numbers[kept[0]]
        counts = given if (np.diff(given) > 0).all() and given[-1] > len(given) - 1 else counts
    line, one_way = _line(counts, times)
    steps = np.diff(counts)
    return FrameTiming(
        reference_ns=reference,
        rate_hz=1.0 / line.slope,
        rate_std_hz=float(np.sqrt(max(line.covariance[1, 1], 0.0))) / line.slope**2,
        counts=counts,
        errors_s=times - line.offset - line.slope * counts,
        interval_std_s=float(np.std(np.diff(times)[steps == 1])) if (steps == 1).any() else float("nan"),
        jitter_s=_spread(times - line.offset - line.slope * counts),
        lost=int((steps - 1).sum()),
        gaps=int((steps > 1).sum()),
        not_later=len(stamps_ns) - len(kept),
        one_way=one_way,
    )


def _count(times: Array) -> Array:
    """Return the number of every frame, including gaps for dropped frames.

    Each frame is expected one period after the expected time of the previous frame.
    """
    period = _usual_step(np.diff(times))
    counts = [0]
    expected = float(times[0])
    for time in times[1:]:
        step = round((time - expected) / period)
        # the previous frame was late; no frame was dropped
        if step < 1 and len(counts) > 1 and counts[-1] - counts[-2] > 1:
            counts[-1] -= 1
            expected -= period
        step = max(1, round((time - expected) / period))
        expected += step * period
        error = float(time) - expected
        if abs(error) > 0.75 * period:  # several consecutive late frames: restart here
            expected = float(time)
        else:
            expected += FOLLOW * error
        counts.append(counts[-1] + step)
    return np.array(counts)


def _usual_step(steps: Array) -> float:
    """Return the period: the mean of the steps near the median, which drops do not affect."""
    middle = float(np.median(steps))
    return float(steps[np.abs(steps - middle) < 0.4 * middle].mean())


def _line(counts: Array, times: Array) -> tuple[Line, bool]:
    """Return the line of timestamps over frame counts, and whether the timestamps are one-way delayed.

    For one-way delays, the line lies below the timestamps.
    """
    x = counts.astype(float)
    line = fit_line(x, times, np.full(len(x), 1e-9))
    error = times - line.offset - line.slope * x
    low, middle, high = np.quantile(error, [0.05, 0.5, 0.95])
    if len(x) >= 100 and high - middle > LATE_RATIO * (middle - low) and high - middle > 2e-5:
        return fit_lower_line(x, times), True
    return line, False


def _spread(errors: Array) -> float:
    return 1.4826 * float(np.median(np.abs(errors - np.median(errors))))


@dataclass(frozen=True, eq=False)
class CameraClockReport:
    """Properties of a camera's clock, from its frame timestamps.

    Args:
        name: name of the camera.
        timing: timing of its frames.
        nominal_hz: (Hz) nearest usual rate.
        off_ppm: (ppm) deviation of the camera from it.
        paced: (0..1) concentration of timestamps on the grid of the host's seconds.
        beat_s: (s) peak-to-peak deviation of smoothed frame times from an even clock.
        late_p99_s: (s) 99th percentile of the lateness of timestamps, minus the median.
    """

    name: str
    timing: FrameTiming
    nominal_hz: float
    off_ppm: float
    paced: float
    beat_s: float
    late_p99_s: float

    @property
    def period_s(self) -> float:
        """Return the seconds between frames."""
        return 1.0 / self.timing.rate_hz

    @property
    def lost_share(self) -> float:
        """Return the share of dropped frames among all frames."""
        return self.timing.lost / (len(self.timing.counts) + self.timing.lost)


def measure_camera(
    name: str, stamps_ns: Sequence[int], numbers: Sequence[int] | None = None
) -> CameraClockReport:
    """Measure the clock of one camera, see `measure_frames`.

    Raises:
        DataError: too few frames; the message has the camera's name.
    """
    try:
        timing = measure_frames(stamps_ns, numbers)
    except DataError as error:
        raise DataError(f"camera {name}: {error}") from None
    nominal = min(USUAL_RATES, key=lambda rate: abs(np.log(timing.rate_hz / rate)))
    errors = timing.errors_s - np.median(timing.errors_s)
    width = min(SMOOTH, len(errors))
    smooth = np.convolve(errors, np.full(width, 1.0 / width), "valid")
    times = np.array([stamp % SECOND for stamp in stamps_ns], float) / SECOND
    grid = round(timing.rate_hz)
    return CameraClockReport(
        name=name,
        timing=timing,
        nominal_hz=nominal,
        off_ppm=1e6 * (timing.rate_hz / nominal - 1.0),
        paced=float(np.abs(np.exp(2j * np.pi * times * grid).mean())) if grid else 0.0,
        beat_s=float(np.quantile(smooth, 0.98) - np.quantile(smooth, 0.02)),
        late_p99_s=float(np.quantile(errors, 0.99)),
    )


def phase_s(one: CameraClockReport, other: CameraClockReport) -> float:
    """Return how much later (s) frames of `other` are than the nearest ones of `one`; NaN if rates differ."""
    if abs(one.timing.rate_hz / other.timing.rate_hz - 1.0) > SAME_RATE:
        return float("nan")
    period = one.period_s
    begin = max(one.timing.reference_ns, other.timing.reference_ns)
    ends = [
        c.timing.reference_ns + SECOND * float(c.timing.counts[-1]) / c.timing.rate_hz for c in (one, other)
    ]
    middle = 0.5 * (begin + min(ends))
    phases = [((middle - c.timing.reference_ns) / SECOND - _offset(c)) % c.period_s for c in (one, other)]
    later = (phases[0] - phases[1]) % period
    return later - period if later > 0.5 * period else later


def _offset(camera: CameraClockReport) -> float:
    return -float(np.median(camera.timing.errors_s - camera.timing.errors_s.min()))


def findings(cameras: Sequence[CameraClockReport]) -> tuple[Notice, ...]:
    """Return notices on problems of the cameras' clocks, warnings first; empty if there are none."""
    notices: list[Notice] = []
    for camera in cameras:
        notices += _of_camera(camera)
    notices += _paced(cameras) + _of_rates(cameras) + _of_phases(cameras)
    return tuple(sorted(notices, key=lambda notice: notice.severity != "warning"))


def _of_camera(camera: CameraClockReport) -> list[Notice]:
    name, timing = camera.name, camera.timing
    off, unsure = abs(camera.off_ppm) * 1e-6, 4.0 * timing.rate_std_hz / timing.rate_hz
    notices: list[Notice] = []
    if camera.lost_share > MANY_LOST:
        notices.append(
            _warning(
                "dropped",
                camera,
                f"camera {name} drops {100 * camera.lost_share:.1f} % of its frames ({timing.lost} in "
                f"{timing.gaps} gaps): give it a USB controller of its own, a lower resolution, or a "
                "compressed format",
            )
        )
    if timing.not_later:
        notices.append(
            _warning(
                "stamps_back",
                camera,
                f"{timing.not_later} stamps of camera {name} are not later than the one before: its clock "
                "was set back, or frames are stamped out of order; use a monotonic clock",
            )
        )
        return notices  # timestamps that go back have no common line
    if off > max(RATE_OFF, unsure):
        notices.append(
            _warning(
                "odd_rate",
                camera,
                f"camera {name} sends {timing.rate_hz:.3f} frames a second, which is not a usual rate (the "
                f"nearest is {camera.nominal_hz:.5g}): its exposure may be longer than a frame, or the "
                "link too slow",
            )
        )
    if camera.beat_s > BEAT * camera.period_s:
        notices.append(
            _warning(
                "beats",
                camera,
                f"frames of camera {name} wander by {1e3 * camera.beat_s:.0f} ms about an even clock: "
                "the camera's rate beats with the rate at which it is read; wait for frames instead of "
                "polling, or trigger it",
            )
        )
    return notices


def _paced(cameras: Sequence[CameraClockReport]) -> list[Notice]:
    paced = [
        c
        for c in cameras
        if c.paced > PACED and not c.timing.not_later and c.timing.jitter_s > PACED_JITTER_S
    ]
    if not paced:
        return []
    names = ", ".join(camera.name for camera in paced)
    text = (
        f"stamps of {names} lie on the grid of the host's seconds: frames are read at the host's pace, "
        "not at the camera's, so stamps are times of reading, up to a period after the exposure; use the "
        "driver's stamps, or a trigger"
    )
    return [Notice("sync_report.paced_by_host", "warning", text, {"cameras": [c.name for c in paced]})]


def _of_rates(cameras: Sequence[CameraClockReport]) -> list[Notice]:
    rates = sorted({round(camera.nominal_hz, 3) for camera in cameras})
    sure = all(camera.timing.jitter_s < PACED_JITTER_S for camera in cameras)  # otherwise 29.97 may be 30
    if len(rates) < 2 or not (sure or rates[-1] > 1.01 * rates[0]):
        return []
    listed = " and ".join(f"{rate:g}" for rate in rates)
    text = (
        f"cameras have different rates ({listed} fps): sets follow the fastest; slower cameras are absent in "
        "some, and no two frames are of one instant. Never pair them by index"
    )
    return [Notice("sync_report.mixed_rates", "info", text, {"rates_hz": rates})]


def _of_phases(cameras: Sequence[CameraClockReport]) -> list[Notice]:
    notices: list[Notice] = []
    for camera in cameras[1:]:
        phase = phase_s(cameras[0], camera)
        slip = camera.timing.rate_hz / cameras[0].timing.rate_hz - 1.0
        noise = 3.0 * max(camera.timing.jitter_s, cameras[0].timing.jitter_s)
        if not abs(phase) > max(OUT_OF_PHASE * camera.period_s, noise):
            continue
        slow = f", and slip by {6e4 * abs(slip):.2g} ms a minute" if abs(slip) > 2e-6 else ""
        text = (
            f"frames of camera {camera.name} are {1e3 * phase:+.1f} ms from those of "
            f"{cameras[0].name}{slow}: the two are not triggered together; views keep their own "
            "stamps, so people who move are still right, a little less precise"
        )
        values = {"cameras": [cameras[0].name, camera.name], "phase_s": phase, "slip_ppm": 1e6 * slip}
        notices.append(Notice("sync_report.out_of_phase", "info", text, values))
    return notices


def timecode_findings(told: Sequence[Notice]) -> tuple[Notice, ...]:
    """Return the timecode notices of the stages; equal ones of a device are merged, with their count."""
    return tuple(_each_once([notice for notice in told if notice.code != "clocks.stamp_back"]))


def _each_once(told: Sequence[Notice]) -> list[Notice]:
    kinds: dict[tuple[str, str], list[Notice]] = {}
    for notice in told:
        kinds.setdefault((notice.code, str(notice.values.get("device"))), []).append(notice)
    return [_with_count(same[0], len(same)) for same in kinds.values()]


def _with_count(notice: Notice, count: int) -> Notice:
    return notice if count == 1 else replace(notice, text=f"{notice.text} (the first of {count})")


def _warning(code: str, camera: CameraClockReport, text: str) -> Notice:
    return Notice(f"sync_report.{code}", "warning", text, {"camera": camera.name})
