"""What is wrong with the clocks of a capture, in plain words, and what to do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from panoptic_ros.clocks.frames import FrameTiming, measure_frames
from panoptic_ros.clocks.stage import RATE_OFF
from panoptic_ros.errors import DataError
from panoptic_ros.stage import Notice

Array = np.ndarray
SECOND = 1_000_000_000
USUAL_RATES = (
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
MANY_LOST = 0.005
PACED = 0.6  # concentration of stamps on the host's grid
PACED_JITTER_S = 3e-4  # hardware stamps may lie on a grid as well, but scatter less
BEAT = 0.25  # of a period, that frames wander about an even clock
SAME_RATE = 8e-4
OUT_OF_PHASE = 0.1  # of a period
SMOOTH = 15  # frames


@dataclass(frozen=True, eq=False)
class CameraClock:
    """What the stamps of one camera tell.

    Args:
        nominal_hz: the usual rate that is nearest; off_ppm: how far the camera is from it.
        paced: concentration in 0..1 of stamps on the grid of the seconds of the host.
        beat_s: by how much smoothed frame times wander about an even clock, peak to peak.
        late_p99_s: 99th percentile of how late stamps are, minus the median.
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
        """Seconds between frames."""
        return 1.0 / self.timing.rate_hz

    @property
    def lost_share(self) -> float:
        """Of all frames that should be there."""
        return self.timing.lost / (len(self.timing.counts) + self.timing.lost)


def measure_camera(name: str, stamps_ns: Sequence[int], numbers: Sequence[int] | None = None) -> CameraClock:
    """See `frames.measure_frames`.

    Raises:
        DataError: for too few frames, with the camera's name.
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
    return CameraClock(
        name=name,
        timing=timing,
        nominal_hz=nominal,
        off_ppm=1e6 * (timing.rate_hz / nominal - 1.0),
        paced=float(np.abs(np.exp(2j * np.pi * times * grid).mean())) if grid else 0.0,
        beat_s=float(np.quantile(smooth, 0.98) - np.quantile(smooth, 0.02)),
        late_p99_s=float(np.quantile(errors, 0.99)),
    )


def phase_s(one: CameraClock, other: CameraClock) -> float:
    """How much later frames of `other` are than the nearest ones of `one`, s; NaN if the rates differ."""
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


def _offset(camera: CameraClock) -> float:
    return -float(np.median(camera.timing.errors_s - camera.timing.errors_s.min()))


def findings(cameras: Sequence[CameraClock]) -> tuple[Notice, ...]:
    """What a person should know, the worst first; nothing if all is well."""
    notices: list[Notice] = []
    for camera in cameras:
        notices += _of_camera(camera)
    notices += _paced(cameras) + _of_rates(cameras) + _of_phases(cameras)
    return tuple(sorted(notices, key=lambda notice: notice.severity != "warning"))


def _of_camera(camera: CameraClock) -> list[Notice]:
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
        return notices  # no single line holds
    if off > max(RATE_OFF, unsure):
        notices.append(
            _warning(
                "odd_rate",
                camera,
                f"camera {name} gives {timing.rate_hz:.3f} frames a second, which is no usual rate (the "
                f"nearest is {camera.nominal_hz:.5g}): its exposure may be longer than a frame, or the "
                "link too slow",
            )
        )
    if camera.beat_s > BEAT * camera.period_s:
        notices.append(
            _warning(
                "beats",
                camera,
                f"frames of camera {name} wander by {1e3 * camera.beat_s:.0f} ms about an even clock: the "
                "camera's rate beats with that at which it is read; wait for frames in place of polling, or "
                "trigger it",
            )
        )
    return notices


def _paced(cameras: Sequence[CameraClock]) -> list[Notice]:
    paced = [
        c
        for c in cameras
        if c.paced > PACED and not c.timing.not_later and c.timing.jitter_s > PACED_JITTER_S
    ]
    if not paced:
        return []
    names = ", ".join(camera.name for camera in paced)
    text = (
        f"stamps of {names} lie on the grid of the host's seconds: frames are read at the host's pace, not "
        "at the camera's, so stamps tell when a frame was read, up to a period after its exposure; use the "
        "driver's stamps, or a trigger"
    )
    return [Notice("sync_report.paced_by_host", "warning", text, {"cameras": [c.name for c in paced]})]


def _of_rates(cameras: Sequence[CameraClock]) -> list[Notice]:
    rates = sorted({round(camera.nominal_hz, 3) for camera in cameras})
    sure = all(camera.timing.jitter_s < PACED_JITTER_S for camera in cameras)  # else 29.97 may be 30
    if len(rates) < 2 or not (sure or rates[-1] > 1.01 * rates[0]):
        return []
    listed = " and ".join(f"{rate:g}" for rate in rates)
    text = (
        f"cameras have different rates ({listed} fps): sets follow the fastest; slower cameras are absent in "
        "some, and no two frames are of one instant. Never pair them by index"
    )
    return [Notice("sync_report.mixed_rates", "info", text, {"rates_hz": rates})]


def _of_phases(cameras: Sequence[CameraClock]) -> list[Notice]:
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
    """The notices of stages about timecode; equal ones of a device are one, with their number."""
    return tuple(_each_once([notice for notice in told if notice.code != "clocks.stamp_back"]))


def _each_once(told: Sequence[Notice]) -> list[Notice]:
    kinds: dict[tuple[str, str], list[Notice]] = {}
    for notice in told:
        kinds.setdefault((notice.code, str(notice.values.get("device"))), []).append(notice)
    return [_with_count(same[0], len(same)) for same in kinds.values()]


def _with_count(notice: Notice, count: int) -> Notice:
    return notice if count == 1 else replace(notice, text=f"{notice.text} (the first of {count})")


def _warning(code: str, camera: CameraClock, text: str) -> Notice:
    return Notice(f"sync_report.{code}", "warning", text, {"camera": camera.name})
