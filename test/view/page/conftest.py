"""A recording that pages are shown."""

import pytest
from recorded_scene import write_scene


@pytest.fixture(scope="session")
def recording(tmp_path_factory):
    """Path of a bag of four seconds; see `recorded_scene`."""
    path = tmp_path_factory.mktemp("recording") / "bag"
    write_scene(path)
    return path
