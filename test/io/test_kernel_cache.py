"""A full disk is told."""

import errno

import pytest

from panoptic_ros.errors import EnvironmentProblem
from panoptic_ros.io.kernel_cache import full_disk_told


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT])
def test_a_full_disk_is_one_line(number):
    with pytest.raises(EnvironmentProblem, match="Full: make room.*NUMBA_CACHE_DIR"), full_disk_told():
        raise OSError(number, "Full")


def test_other_errors_of_the_system_are_left_alone():
    with pytest.raises(PermissionError), full_disk_told():
        raise PermissionError(errno.EACCES, "no")
