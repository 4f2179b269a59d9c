"""How much runs side by side."""

from panoptic_ros.running.plans.free_threads import free_threads


def test_threads_of_operators_share_the_cores():
    assert free_threads(1) >= 1 and free_threads(10_000) == 1
