"""What is timed and what is not."""

from panoptic_ros.study.stage1.stage1 import exponent
from panoptic_ros.study.stopwatch import timed


def test_every_item_is_done_but_the_first_not_timed():
    done = []
    results, times = timed(lambda item: done.append(item) or 2 * item, range(5), budget_s=60.0)
    assert done == [0, 1, 2, 3, 4] and results == [0, 2, 4, 6, 8] and times.calls == 4
    assert timed(lambda item: item, range(3), 60.0, warmed=True)[1].calls == 3
    assert timed(lambda item: item, [], 60.0)[1].calls == 0


def test_a_budget_ends_it_after_one_timed_call():
    def work(item):
        return sum(range(20000))

    results, times = timed(work, range(100), budget_s=0.0)
    assert times.calls == 1 and len(results) == 2


def test_exponent_of_a_power_law():
    sizes = [1, 2, 5, 40]
    assert abs(exponent(sizes, [3.0 * s**1.7 for s in sizes]) - 1.7) < 1e-12
    assert exponent([4, 4], [1.0, 2.0]) is None
