"""Samples of IMUs that come several to a stamp are spread by their rate, and told in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from panoptic_ros.io.kinematic_files import COLUMNS, read_imus

RATE, COUNT, FIRST = 100.0, 120, 1_000_000_000


def write(path: Path, stamps: dict[str, np.ndarray]) -> None:
    """A file in which the k-th sample of a device has the rate k about x."""
    rows = [(int(stamp), name, k) for name, own in stamps.items() for k, stamp in enumerate(own)]
    lines = [",".join(COLUMNS)] + [f"{name},{stamp},1,0,0,0,{k},0,0,0,0,9.81" for stamp, name, k in rows]
    path.write_text("\n".join(lines) + "\n")


def steady(size: int) -> np.ndarray:
    """Stamps of the first sample of each batch of so many."""
    k = np.arange(COUNT)
    return FIRST + np.round((k - k % size) * 1e9 / RATE).astype(np.int64)


@pytest.mark.parametrize("size", [2, 3, 10])
def test_samples_of_batches_have_their_own_times_again(tmp_path: Path, size: int) -> None:
    write(tmp_path / "imu.csv", {f"imu{k:02d}": steady(size) for k in range(13)})
    notices: list[str] = []
    found = read_imus(tmp_path / "imu.csv", notices)
    for series in found.values():
        assert len(series.stamps) == COUNT
        assert np.abs(series.stamps - FIRST - np.arange(COUNT) * 1e9 / RATE).max() <= 1.0
        assert (series.rates[:, 0] == np.arange(COUNT)).all()
    (line,) = notices
    assert line.startswith("imu00, imu01, ") and "imu12: samples come several to a stamp" in line
    assert line.endswith("spread by their rate, 100.0 Hz")


def test_a_gap_behind_a_batch_stays_a_gap(tmp_path: Path) -> None:
    stamps = steady(3)
    stamps[60:] += 2_000_000_000
    write(tmp_path / "imu.csv", {"a": stamps})
    times = read_imus(tmp_path / "imu.csv")["a"].stamps
    assert (np.diff(times) > 0).all() and np.diff(times).max() > 1_900_000_000
    assert np.sort(np.diff(times))[-2] < 16_000_000


def test_single_repeated_stamps_are_left_out(tmp_path: Path) -> None:
    stamps = steady(1)
    stamps[[5, 40]] = stamps[[4, 39]]
    stamps[80] = stamps[70]
    write(tmp_path / "imu.csv", {"a": stamps, "b": stamps, "c": steady(1)})
    notices: list[str] = []
    found = read_imus(tmp_path / "imu.csv", notices)
    assert len(found["a"].stamps) == COUNT - 3 and len(found["c"].stamps) == COUNT
    assert notices == ["a, b: 3 samples are left out, as their stamps are repeated or go back"]


def test_stamps_that_go_back_between_batches(tmp_path: Path) -> None:
    stamps = steady(4)
    stamps[50] = stamps[10]
    write(tmp_path / "imu.csv", {"a": stamps})
    notices: list[str] = []
    series = read_imus(tmp_path / "imu.csv", notices)["a"]
    assert len(series.stamps) == COUNT - 1 and (np.diff(series.stamps) > 0).all()
    assert 50.0 not in series.rates[:, 0] and notices[0].endswith("; 1 left out, as their stamps go back")
