"""Compiled kernels find room, and a full disk is told."""
import errno
import os

import pytest

from panoptic_ros.errors import EnvironmentProblem
from panoptic_ros.io.kernel_cache import find_room_for_kernels, full_disk_told


def test_room_without_a_home(monkeypatch, tmp_path):
    """A read-only installation and no home folder: numba would refuse to import."""
    monkeypatch.setattr(os, "environ", {"HOME": str(tmp_path)})
    find_room_for_kernels()
    assert "NUMBA_CACHE_DIR" not in os.environ
    monkeypatch.setattr(os, "access", lambda place, mode: False)
    find_room_for_kernels()
    assert "panoptic_ros-kernels" in os.environ["NUMBA_CACHE_DIR"]
    monkeypatch.setattr(os, "environ", {"NUMBA_CACHE_DIR": "mine"})
    find_room_for_kernels()
    assert os.environ["NUMBA_CACHE_DIR"] == "mine"


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT])
def test_a_full_disk_is_one_line(number):
    with pytest.raises(EnvironmentProblem, match="Full: make room.*NUMBA_CACHE_DIR"), full_disk_told():
        raise OSError(number, "Full")


def test_other_errors_of_the_system_are_left_alone():
    with pytest.raises(PermissionError), full_disk_told():
        raise PermissionError(errno.EACCES, "no")
