"""What stages remember is kept for their successors, but not what ends them."""

import pytest
from spinning import spin_until

rclpy = pytest.importorskip("rclpy")
from panoptic_ros.nodes.middleware.runtime import OneShot  # noqa: E402
from panoptic_ros.nodes.stages.kept_states import StateExchange, StateKeeper  # noqa: E402

pytestmark = pytest.mark.ros
STAGE = "tracking"


@pytest.fixture
def lab(executor):
    keeping = rclpy.create_node("keeping")
    executor.add_node(keeping)
    return executor, StateKeeper(keeping, [STAGE])


def begun(executor, number, state=b"", proven=True, tried=True):
    """A node that is started, takes a record if it is tried, gives what it remembers if it gets to, and
    dies: what it began with.
    """
    node, found = rclpy.create_node(f"node_{number}"), []
    executor.add_node(node)
    kept = StateExchange(node, [STAGE], lambda: kept.publish(lambda: {STAGE: state}), lambda stage: proven)
    spin_until(executor, lambda: node.count_publishers(f"stages/{STAGE}/kept_state"))
    for _ in range(5):
        executor.spin_once(timeout_sec=0.1)
    kept.when_known(found.append)
    spin_until(executor, lambda: bool(found))
    if tried:
        kept.tried()
    for _ in range(12):
        executor.spin_once(timeout_sec=0.1)
    executor.remove_node(node)
    node.destroy_node()
    return found[0].get(STAGE)


def test_a_successor_begins_with_the_newest_state(lab):
    executor, _ = lab
    assert begun(executor, 1, b"one") is None
    assert begun(executor, 2, b"two") == b"one"
    assert begun(executor, 3) == b"two"


def test_a_state_that_fails_twice_is_not_handed_out_again(lab):
    executor, _ = lab
    assert begun(executor, 1, b"poison") is None
    assert begun(executor, 2, b"poison", proven=False) == b"poison"
    assert begun(executor, 3, b"poison", proven=False) == b"poison"
    assert begun(executor, 4, b"good") is None
    assert begun(executor, 5, b"good") == b"good"


def test_a_node_that_is_killed_before_it_takes_anything_says_nothing_about_its_state(lab):
    executor, _ = lab
    assert begun(executor, 1, b"good") is None
    for number in (2, 3, 4):
        assert begun(executor, number, b"good", proven=False, tried=False) == b"good"


def test_states_that_take_long_are_handed_over_less_often(lab):
    executor, _ = lab
    node, times = rclpy.create_node("slow"), iter(range(100))
    executor.add_node(node)
    taken, begun = [], []
    kept = StateExchange(
        node,
        [STAGE],
        lambda: kept.publish(lambda: taken.append(1) or {STAGE: b"large"}),
        lambda stage: True,
        lambda: 0.03 * next(times),
    )
    asked, ask = [], kept._ask_for
    kept._ask_for = lambda: (asked.append(1), ask())
    kept.when_known(begun.append)
    spin_until(executor, lambda: len(asked) >= 6)
    assert len(taken) == 2  # of 0.03 s each: every fourth time


def test_a_timer_fires_once_even_if_its_executor_calls_it_again(executor):
    node, fired = rclpy.create_node("waiting"), []
    executor.add_node(node)
    first, second = (OneShot(node, 0.0, lambda k=k: fired.append(k)) for k in (1, 2))
    second.cancel()
    spin_until(executor, lambda: bool(fired))
    first._fire()
    second._fire()
    assert fired == [1]
