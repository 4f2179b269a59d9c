"""Read the IMU samples of a capture folder from `imu.csv`."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from functools import lru_cache
from heapq import merge
from pathlib import Path

from panoptic_ros.domain import ImuSample
from panoptic_ros.domain.subjects import ImuSeries
from panoptic_ros.io.kinematic_files import read_imus

NAMES = ("imu.csv", "imu.csv.gz")


def imu_file(folder: Path) -> Path | None:
    """Return the file with IMU samples in a capture folder; None if there is none."""
    return next((folder / name for name in NAMES if (folder / name).is_file()), None)


def imu_devices(path: Path) -> tuple[str, ...]:
    """Return the names of the devices in a file.

    Raises:
        DataError: naming the file, the line and the fault.
    """
    return tuple(_series(path))


def imu_samples(path: Path, devices: Collection[str], until_ns: int | None = None) -> Iterator[ImuSample]:
    """Yield the samples of some devices in the order of their timestamps.

    Args:
        until_ns: samples with this timestamp and later ones are skipped.

    Raises:
        DataError: as `imu_devices`, or if a sample is invalid.
    """
    found = _series(path)
    rows = [_samples(name, found[name]) for name in devices]
    for sample in merge(*rows, key=lambda sample: sample.stamp_ns):
        if until_ns is not None and sample.stamp_ns >= until_ns:
            return
        yield sample


def _samples(name: str, series: ImuSeries) -> Iterator[ImuSample]:
    for k, stamp in enumerate(series.stamps.tolist()):
        yield ImuSample(name, stamp, series.quaternions[k], series.rates[k], series.forces[k])


@lru_cache(maxsize=2)
def _series(path: Path) -> dict[str, ImuSeries]:
    return read_imus(path)
