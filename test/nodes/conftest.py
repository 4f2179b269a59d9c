"""A small recorded bag, made once."""
import captures
import pytest
from recordings import write_bag


@pytest.fixture(scope="session")
def recorded(tmp_path_factory):
    return write_bag(tmp_path_factory.mktemp("bag") / "people", captures.views(40))
