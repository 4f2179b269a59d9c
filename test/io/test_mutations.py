"""Readers refuse damaged files with errors of the family: 200 fixed mutations of a sample of every format."""

import itertools

import pytest

from panoptic_ros.study.faults.formats import FORMATS
from panoptic_ros.study.faults.trials import try_copies

MUTATIONS, SEED = 200, 42
SLOW = {"bag": 50, "metadata.yaml": 50, "C3D": 20}  # formats whose library is slow


@pytest.mark.parametrize("name", FORMATS)
def test_no_reader_raises_a_foreign_exception(tmp_path, name):
    numbers = itertools.islice(itertools.count(), SLOW.get(name, MUTATIONS))
    *_, (_, found) = try_copies(name, tmp_path, SEED, numbers)
    assert found.foreign == {}
    assert found.refused and found.mutations == SLOW.get(name, MUTATIONS)
