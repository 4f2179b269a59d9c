"""Segments of killed processes are removed, those of living ones stay, and a full /dev/shm is one line."""

import fcntl
import os
import shutil
import time
from types import SimpleNamespace

import pytest

from panoptic_ros.errors import EnvironmentProblem
from panoptic_ros.running.processes import shared_memory
from panoptic_ros.running.processes.shared_memory import full, leftovers, prepare_shared_memory


def segment(folder, name, age_s=60.0, size=1000):
    lock = folder / f"{name}_el"
    for path in (folder / name, lock, folder / f"sem.{name}_mutex"):
        path.write_bytes(bytes(size))
        os.utime(path, (time.time() - age_s,) * 2)
    return lock


def test_segments_of_dead_processes_alone_are_removed(tmp_path):
    segment(tmp_path, "fastrtps_dead")
    segment(tmp_path, "fastrtps_port7411")
    segment(tmp_path, "fastrtps_young", age_s=0.0)
    alive = segment(tmp_path, "fastrtps_alive")
    (tmp_path / "psm_of_somebody_else").write_bytes(b"mine")
    with alive.open("rb+") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        assert prepare_shared_memory(tmp_path) == 6000
        left = sorted(path.name for path in tmp_path.iterdir())
    assert [name for name in left if "alive" not in name and "young" not in name] == ["psm_of_somebody_else"]
    assert len(left) == 7


def test_segments_of_other_users_stay(tmp_path, monkeypatch):
    segment(tmp_path, "fastrtps_dead")
    monkeypatch.setattr(os, "getuid", lambda: 12345)
    assert leftovers(tmp_path) == []


def test_a_full_one_is_told_in_a_line_that_names_its_largest_file(tmp_path, monkeypatch):
    (tmp_path / "small").write_bytes(b"1")
    (tmp_path / "large").write_bytes(bytes(3 << 20))
    usage = SimpleNamespace(total=64 << 20, free=4096)
    monkeypatch.setattr(shared_memory.shutil, "disk_usage", lambda path: usage)
    with pytest.raises(EnvironmentProblem) as error:
        prepare_shared_memory(tmp_path)
    assert "4 KiB of 64 MiB free, 3 MiB of it large" in str(error.value) and "\n" not in str(error.value)
    assert "--shm-size" in full(tmp_path)


def test_no_shared_memory_is_no_trouble(tmp_path):
    assert prepare_shared_memory(tmp_path / "none") == 0
    assert shutil.disk_usage(tmp_path).free > 0
