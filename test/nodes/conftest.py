"""A small recorded bag, made once."""

import captures
import pytest
from recordings import write_bag


@pytest.fixture(scope="session")
def recorded(tmp_path_factory):
    return write_bag(tmp_path_factory.mktemp("bag") / "people", captures.views(40))


@pytest.fixture
def ros():
    """The middleware, for one test."""
    rclpy = pytest.importorskip("rclpy")
    rclpy.init(args=[])
    yield
    rclpy.try_shutdown()


@pytest.fixture
def executor(ros):
    """What is added to it is taken down in any case."""
    from rclpy.executors import SingleThreadedExecutor

    executor = SingleThreadedExecutor()
    yield executor
    nodes = executor.get_nodes()
    executor.shutdown()
    for node in nodes:
        if hasattr(node, "close"):
            node.close()
        node.destroy_node()
