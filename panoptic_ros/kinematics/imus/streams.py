"""Newest samples of all IMUs, interpolated at any instant, and detection of faulty devices.

`unit_fault` infers the unit of a gyroscope's rates from the rotation of the same device's orientation. Bodies
are not solved from rates, but other readers of the rates should know. A driver with this error may have
others.

`DeviceAssignment` holds which person wears which device. It returns what each person's devices measured at an
instant.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from panoptic_ros.domain.bodies import ImuSample
from panoptic_ros.domain.subjects import Subject
from panoptic_ros.geometry.rotations import from_quaternions, vectors_of
from panoptic_ros.kinematics.imus.measured import LONGEST_GAP_S, NOTHING_MEASURED, ImuMeasurements, slerp
from panoptic_ros.stage import Notice

Array = np.ndarray

LEAST_RATE = 0.3  # rad/s, minimum root mean square rate of a moving person
ALIKE = 0.5  # minimum cosine between rates from orientations and rates from the gyroscope
DEGREES = math.degrees(1.0)  # factor by which rates in deg/s are too large if read as rad/s: 57.3
BETWEEN = math.sqrt(DEGREES)  # threshold of this factor: the geometric mean of 1 (correct) and 57.3 (deg/s)
NO_ROWS = np.zeros(0, np.int64)
KEPT = 64  # samples of a device
NEAREST_NS = 2_000_000  # minimum interval between samples: denser samples add no information
SILENT_NS = 500_000_000  # ns without samples after which a device is reported as silent
# ns, as SILENT_NS if most devices are silent at once, as when the machine stalls
ALL_SILENT_NS = 2_000_000_000
FEW = 2  # number of silent devices that is never considered most devices
# minimum fraction of dropped samples of a device with too high a rate; a device of 1 kHz loses less
FLOOD = 0.6
# s, decay time of the numbers of kept and dropped samples; minimum number of dropped samples
FLOOD_S, FEWEST = 2.0, 100
UPRIGHT_S = 3.0  # s, averaging time of the specific force: the mean for a moving person is that of gravity
UPRIGHT = 5.0  # m/s^2, maximum difference of the mean specific force from gravity
GRAVITY = np.array([0.0, 0.0, 9.81])
FEWEST_TURNS = 30  # minimum number of rotations between samples for the check of the rates' unit
FEWEST_UNORIENTED = 30  # consecutive samples without an orientation: half a second at the usual rate
NONE = -1  # stands for a missing timestamp


def turned_by(before: Array, after: Array, seconds: Array) -> Array:
    """Return angular velocities (N, 3) rad/s in the device frame, from pairs of orientations.

    Args:
        before, after: (N, 4) quaternions w x y z.
        seconds: (N,) s between them.
    """
    begin, end = from_quaternions(before), from_quaternions(after)
    apart = vectors_of(np.ascontiguousarray(begin.swapaxes(1, 2) @ end))
    found: Array = apart / seconds[:, None]
    return found


def rate_sums(own: Array, told: Array) -> Array:
    """Return terms (N, 4) to be summed: 1, both squared rates, and their product.

    Args:
        own: (N, 3) rad/s, rates from orientations.
        told: (N, 3), rates from gyroscopes.
    """
    return np.column_stack([np.ones(len(own)), (own**2).sum(-1), (told**2).sum(-1), (own * told).sum(-1)])


def odd_units(sums: Array) -> Array:
    """Return which devices (N,) report rates in another unit, from sums (N, 4) of `rate_sums`.

    Devices that hardly move are not flagged.
    """
    count, own, told, both = sums.T
    moves = (count > 0.0) & (own >= count * LEAST_RATE**2) & (told > 0.0)
    alike = both >= ALIKE * np.sqrt(own * told)
    found: Array = moves & alike & ((told > BETWEEN**2 * own) | (told < own / BETWEEN**2))
    return found


def unit_fault(sums: Array) -> str:
    """Return the fault in the unit of a device's rates as text, or "" for none.

    Without enough motion the result is "" too.

    Args:
        sums: (4,), sums of `rate_sums`.
    """
    if not odd_units(sums[None])[0]:
        return ""
    _, own, told, _ = sums.tolist()
    ratio = math.sqrt(told / own)
    guess = "deg/s" if ratio > 1.0 else "rad/s converted from deg twice"
    return (
        f"sends angular velocities {ratio:.3g} times as large as its orientation turns, so perhaps "
        f"{guess}; expected rad/s; bodies are solved without them"
    )


class DeviceAssignment:
    """Assignment of devices to the designated people who wear them."""

    def __init__(self, subjects: Sequence[Subject]):
        self.devices = tuple(dict.fromkeys(d.name for s in subjects for d in s.devices))
        self._who = {d.name: s.id for s in reversed(subjects) for d in s.devices}
        rows = {name: d for d, name in enumerate(self.devices)}
        self._rows = {s.id: np.array([rows[d.name] for d in s.devices], np.int64) for s in subjects}

    def of(self, device: str) -> int | None:
        """Return the id of the person who wears a device, or None."""
        return self._who.get(device)

    def measured(
        self, streams: ImuStreams, stamp_ns: int, offsets: Mapping[int, int]
    ) -> dict[int, ImuMeasurements]:
        """Return the measurements of each person's devices at an instant, by id of the person.

        Devices are in the order of the subject.

        Args:
            streams: Streams of `devices`.
            offsets: Clock offset of each person's devices, ns, by id.
        """
        found = {offset: streams.at(stamp_ns - offset) for offset in set(offsets.values())}
        return {
            number: found[offset].rows(self._rows.get(number, NO_ROWS)) for number, offset in offsets.items()
        }


class ImuStreams:
    """Newest samples of the devices that people wear.

    Args:
        devices: Names.
    """

    def __init__(self, devices: Sequence[str]):
        self.names = tuple(devices)
        self._numbers = {name: d for d, name in enumerate(self.names)}
        count = len(self.names)
        self._stamps = np.full((count, KEPT), NONE)
        self._values = np.full((count, KEPT, 10), np.nan)  # quaternion w x y z, force (3), rate (3)
        self._force = np.zeros((count, 3))  # mean specific force in the inertial frame, m/s^2
        self._weight = np.zeros(count)  # s over which this mean was taken
        self._odd = np.zeros(count, bool)  # measures in another convention
        self._silent = np.zeros(count, bool)  # silent, and reported
        self._taken = np.zeros((count, 2))  # recent counts of kept and of dropped samples
        self._flooding = np.zeros(count, bool)
        self._rates = np.zeros((count, 4))  # recent sums, see `rate_sums`
        self._learnt = np.full(count, NONE)  # timestamps of the newest samples in these sums
        self._rates_told = np.zeros(count, bool)
        # number of consecutive newest samples without an orientation
        self._unoriented = np.zeros(count, np.int64)
        self._batch = np.full(count, NONE)  # timestamp of the newest batch of samples
        self._batched = np.zeros(count, np.int64)  # number of samples in this batch
        self._period = np.zeros(count, np.int64)  # ns between samples of the previous batch; 0 = unknown
        self._first = np.ones(count, bool)  # only one timestamp so far
        self._batches_told = False

    @property
    def last(self) -> Array:
        """Return the timestamps (D,) of the newest samples, -1 where there is none."""
        found: Array = self._stamps[:, -1]
        return found

    def take(self, sample: ImuSample) -> tuple[Notice, ...]:
        """Add a sample and return notices.

        A sample that is not newer than the last one is dropped, with a notice. A batch is several samples
        with one timestamp; they are spread at the sample interval of the previous batch.
        """
        d = self._numbers.get(sample.device)
        if d is None:
            return ()
        stamps, values = self._stamps[d], self._values[d]
        last = int(stamps[-1])
        stamp, told = self._spread(d, sample.stamp_ns)
        if stamp <= last:
            if self._first[d] and sample.stamp_ns == last:
                return ()  # possibly a batch: the next timestamp determines its rate
            text = (
                f"{sample.device} sends the stamp {sample.stamp_ns} after {last}; such samples are left out"
            )
            return (_notice("imu_stamps", "warning", text, sample.device),)
        is_near = last != NONE and stamp - last < NEAREST_NS
        self._taken[d, int(is_near)] += 1.0
        if is_near:
            return told
        stamps[:-1], values[:-1] = stamps[1:], values[1:]
        stamps[-1] = stamp
        values[-1, :4], values[-1, 4:7], values[-1, 7:] = sample.orientation, sample.force, sample.rate
        self._unoriented[d] = self._unoriented[d] + 1 if np.isnan(sample.orientation[0]) else 0
        if self._unoriented[d] == FEWEST_UNORIENTED:
            text = (
                f"{sample.device} has no orientation (zeros, NaN or a covariance of -1), so bodies are "
                "solved without it; let its driver estimate one"
            )
            told = (*told, _notice("unoriented", "warning", text, sample.device))
        return told

    def _spread(self, d: int, stamp_ns: int) -> tuple[int, tuple[Notice, ...]]:
        """Return the time of a device's sample with this timestamp, and a notice at the first batch."""
        begin, count = int(self._batch[d]), int(self._batched[d])
        if stamp_ns > begin:
            if begin != NONE and count > 1:
                self._period[d] = (stamp_ns - begin) // count
            self._first[d] = begin == NONE
            self._batch[d], self._batched[d] = stamp_ns, 1
            return stamp_ns, ()
        self._batched[d] += int(stamp_ns == begin)
        if stamp_ns < begin or not self._period[d]:
            return stamp_ns, ()
        told: tuple[Notice, ...] = ()
        if not self._batches_told:
            self._batches_told = True
            rate = 1e9 / int(self._period[d])
            text = f"IMUs send several samples with one stamp, which are spread by their rate, {rate:.0f} Hz"
            told = (_notice("batches", "info", text, self.names[d]),)
        return stamp_ns + count * int(self._period[d]), told

    def at(self, stamp_ns: int) -> ImuMeasurements:
        """Return the measurements of all devices at an instant.

        Orientations (slerp) and forces (linear) are interpolated between the samples before and after it.
        """
        if not self.names:
            return NOTHING_MEASURED
        rows = np.arange(len(self.names))
        after = np.clip((self._stamps < stamp_ns).sum(1), 1, KEPT - 1)
        begin, end = self._stamps[rows, after - 1], self._stamps[rows, after]
        gap = end - begin
        share = (stamp_ns - begin) / np.maximum(gap, 1)
        usable = (begin != NONE) & (gap < LONGEST_GAP_S * 1e9) & (share > -0.5) & (share < 1.5) & ~self._odd
        share = np.clip(share, 0.0, 1.0)[:, None]
        first, second = self._values[rows, after - 1], self._values[rows, after]
        forces = first[:, 4:7] * (1.0 - share) + second[:, 4:7] * share
        with np.errstate(invalid="ignore"):
            turns = from_quaternions(slerp(_unit(first[:, :4]), _unit(second[:, :4]), share))
        return ImuMeasurements(usable, turns, forces)

    def judge(self, stamp_ns: int, period: float) -> list[Notice]:
        """Check all devices once per instant, and return notices.

        The checks are for silence, floods of samples, the unit of rates, and the convention of frame and
        sign.

        Args:
            period: s since the previous instant.
        """
        if not self.names:
            return []
        notices = []
        come, passed = self.last != NONE, stamp_ns - self.last
        silent = come & (passed > SILENT_NS)
        limit = ALL_SILENT_NS if silent.sum() > max(FEW, 0.5 * come.sum()) else SILENT_NS
        for d in np.flatnonzero(silent & (passed > limit) & ~self._silent).tolist():
            text = f"{self.names[d]} has been silent for {1e-9 * limit:g} s; bodies are solved without it"
            notices.append(_notice("imu_silent", "warning", text, self.names[d]))
        for d in np.flatnonzero(self._silent & ~silent).tolist():
            notices.append(_notice("imu_back", "info", f"{self.names[d]} is back", self.names[d]))
        self._silent = silent & (self._silent | (passed > limit))
        notices += self._floods(period)
        notices += self._units(period)
        newest = self._values[:, -1]
        with np.errstate(invalid="ignore"):
            forces = (from_quaternions(newest[:, :4]) @ newest[:, 4:7, None])[..., 0]
        known = np.isfinite(forces).all(-1) & ~silent
        share = period / np.minimum(self._weight + period, UPRIGHT_S)
        self._force[known] += share[known, None] * (forces[known] - self._force[known])
        self._weight[known] += period
        far = np.linalg.norm(self._force - GRAVITY, axis=-1)
        odd = (self._weight >= UPRIGHT_S) & (far > UPRIGHT)
        for d in np.flatnonzero(odd & ~self._odd).tolist():
            mean = np.array2string(self._force[d], precision=1)
            text = (
                f"{self.names[d]} measures a mean force of {mean} m/s^2 in its inertial frame, expected "
                "(0, 0, 9.81): z up, quaternions that turn device vectors into it, m/s^2, gravity not "
                "subtracted; it is left out"
            )
            notices.append(_notice("imu_convention", "warning", text, self.names[d]))
        self._odd = odd
        return notices

    def _learn_rates(self) -> None:
        """Update the rate sums: compare the rotation between the two newest samples with gyroscope rates."""
        before, newest = self._stamps[:, -2], self._stamps[:, -1]
        new = (newest != self._learnt) & (before != NONE) & (newest - before < LONGEST_GAP_S * 1e9)
        self._learnt[:] = newest
        which = np.flatnonzero(new & np.isfinite(self._values[:, -2:, [0, 7]]).all((1, 2)))
        if len(which):
            turns = self._values[which, -2:, :4]
            own = turned_by(turns[:, 0], turns[:, 1], 1e-9 * (newest - before)[which])
            self._rates[which] += rate_sums(own, self._values[which, -2, 7:])

    def _units(self, period: float) -> list[Notice]:
        """Return notices of devices whose rates are in another unit, once per device."""
        self._learn_rates()
        notices = []
        ready = (self._rates[:, 0] >= FEWEST_TURNS) & ~self._rates_told & odd_units(self._rates)
        for d in np.flatnonzero(ready).tolist():
            if fault := unit_fault(self._rates[d]):
                notices.append(_notice("imu_rates", "warning", f"{self.names[d]} {fault}", self.names[d]))
                self._rates_told[d] = True
        self._rates *= max(0.0, 1.0 - period / UPRIGHT_S)
        return notices

    def _floods(self, period: float) -> list[Notice]:
        """Return notices of devices most of whose samples follow another too closely, once per device."""
        kept, left = self._taken.T
        floods = (left > FLOOD * (kept + left)) & (left > FEWEST)
        notices = []
        for d in np.flatnonzero(floods & ~self._flooding).tolist():
            share = left[d] / (kept[d] + left[d])
            text = (
                f"{share:.0%} of the samples of {self.names[d]} are less than 2 ms after another; "
                "they are left out; set a lower rate in its driver"
            )
            notices.append(_notice("imu_flood", "warning", text, self.names[d]))
        self._flooding |= floods
        self._taken *= max(0.0, 1.0 - period / FLOOD_S)
        return notices


def _unit(quaternions: Array) -> Array:
    """Return quaternions of length 1."""
    found: Array = quaternions / np.linalg.norm(quaternions, axis=-1, keepdims=True)
    return found


def _notice(code: str, severity: str, text: str, device: str) -> Notice:
    return Notice(
        f"kinematics.{code}", "warning" if severity == "warning" else "info", text, {"device": device}
    )
