"""Derive a master time line from timecode: it continues over midnight and over jumps of the timecode."""

from __future__ import annotations

from dataclasses import dataclass

from panoptic_ros.domain import Timecode

SECOND = 1_000_000_000
# ns, maximum difference of two devices that are assumed to receive the same generator
SAME_GENERATOR_NS = 10 * SECOND
SILENT_NS = 3 * SECOND  # ns without timecode, while others receive it, after which a device is silent
SAME_JUMP_NS = 100_000  # ns, maximum difference of two devices for the same jump


def day_ns(timecode: Timecode) -> int:
    """Return the real time (ns) since the timecode's midnight.

    Labels are not seconds at 23.976 and 29.97 Hz, so the exact rate is used.
    """
    rate = timecode.rate.exact
    return timecode.frame_count * SECOND * rate.denominator // rate.numerator


def day_length_ns(timecode: Timecode) -> int:
    """Return the real time (ns) of a timecode's day: 86486.4 s at 29.97 Hz without drop-frame."""
    rate = timecode.rate
    frames = 24 * 107_892 if rate.drop_frame else 24 * 3600 * rate.nominal
    return frames * SECOND * rate.exact.denominator // rate.exact.numerator


@dataclass
class TimelinePosition:
    """Position of a device on the time line.

    Args:
        jumps: (index) number of timecode jumps that the device has followed.
        newest_ns: (master time) time of its newest reading.
        heard_ns: (ns) accumulated time with timecode, on a scale that all devices share.
    """

    jumps: int
    newest_ns: int  # master time
    heard_ns: int  # accumulated time with timecode, on a scale that all devices share


class MasterTimeline:
    """Master time line that all devices share.

    A generator that is set again makes every device receive the same jump, some a little later than others.
    Free-running drop-frame generators are often set once a day. Time itself has not jumped. From then on,
    master time is the timecode minus the jump. A device that joins later adopts the jumps of the device with
    the nearest time.
    """

    def __init__(self) -> None:
        self._shifts: list[int] = [0]  # ns added to the timecode, indexed by the number of jumps
        self._places: dict[str, TimelinePosition] = {}

    def master_ns(self, device: str, timecode: Timecode, expected_ns: int | None = None) -> int:
        """Return the master time (ns) of a label, on the day nearest to `expected_ns`.

        Without `expected_ns`, the device's newest time is used. It is also used if `expected_ns` lies on a
        day that no other device has reached.
        """
        place = self._places.get(device)
        if place is None:
            return self._join(device, timecode)
        raw = day_ns(timecode) + self._shifts[place.jumps]
        if expected_ns is None or self._ahead_of_others(device, expected_ns - day_length_ns(timecode) // 2):
            expected_ns = place.newest_ns
        return _nearest_day(raw, timecode, expected_ns)

    def _ahead_of_others(self, device: str, master_ns: int) -> bool:
        """Return whether other devices are active and all of their times are before `master_ns`."""
        silent = self.silent()
        others = [p.newest_ns for n, p in self._places.items() if n != device and n not in silent]
        return bool(others) and max(others) < master_ns

    def heard(self, device: str, master_ns: int) -> None:
        """Advance a device to a master time."""
        place, total = self._places[device], self._total_heard()
        advance = min(max(master_ns - place.newest_ns, 0), SECOND)
        place.heard_ns = total if device in self.silent() else place.heard_ns + advance
        place.newest_ns = master_ns

    def jumped(self, device: str, jump_ns: int) -> None:
        """Record that the timecode of a device has jumped by `jump_ns`."""
        place = self._places[device]
        shift = self._shifts[place.jumps] - jump_ns
        for index in range(place.jumps + 1, len(self._shifts)):
            if abs(self._shifts[index] - shift) <= SAME_JUMP_NS:
                place.jumps = index
                return
        self._shifts.append(shift)
        place.jumps = len(self._shifts) - 1

    def known_jump(self, device: str, jump_ns: int) -> bool:
        """Return whether another device has already received this timecode jump."""
        place = self._places[device]
        shift = self._shifts[place.jumps] - jump_ns
        return any(abs(s - shift) <= SAME_JUMP_NS for s in self._shifts[place.jumps + 1 :])

    def rejoin(self, device: str, master_ns: int) -> int:
        """Adopt the jumps of the nearest other device: a device whose clock jumped may have missed some.

        Args:
            master_ns: master time of the device's newest label.

        Returns:
            Shift to add to the device's times, ns.
        """
        own = self._places[device]
        change, distance = 0, SAME_GENERATOR_NS
        for name, place in self._places.items():
            shift = self._shifts[place.jumps] - self._shifts[own.jumps]
            away = abs(master_ns + shift - place.newest_ns)
            if name != device and away < distance:
                change, distance, jumps = shift, away, place.jumps
        if distance < SAME_GENERATOR_NS:
            own.jumps = jumps
        return change

    def shift_of(self, device: str) -> int:
        """Return the shift (ns) that is added to the times of a device's labels because of jumps."""
        place = self._places.get(device)
        return self._shifts[place.jumps] if place is not None else 0

    def forget(self, device: str) -> None:
        """Remove a device, so that its next reading joins like that of a new device."""
        self._places.pop(device, None)

    def silent(self) -> list[str]:
        """Return the devices without timecode for `SILENT_NS` while another device received it."""
        total = self._total_heard()
        return [name for name, place in self._places.items() if total - place.heard_ns > SILENT_NS]

    def _total_heard(self) -> int:
        return max((place.heard_ns for place in self._places.values()), default=0)

    def _join(self, device: str, timecode: Timecode) -> int:
        """Place a new device on the day, and after the jumps, of the device with the nearest time."""
        raw = day_ns(timecode)
        best, jumps = raw, 0
        distance = SAME_GENERATOR_NS
        for place in self._places.values():
            own = _nearest_day(raw + self._shifts[place.jumps], timecode, place.newest_ns)
            if abs(own - place.newest_ns) < distance:
                best, jumps, distance = own, place.jumps, abs(own - place.newest_ns)
        self._places[device] = TimelinePosition(jumps, best, self._total_heard())
        return best


def _nearest_day(raw_ns: int, timecode: Timecode, expected_ns: int) -> int:
    day = day_length_ns(timecode)
    return raw_ns + day * ((expected_ns - raw_ns + day // 2) // day)
