"""What waits in lines: each in its order, all side by side."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from panoptic_ros.graph.lines import Lines


def test_each_line_keeps_its_order_and_none_waits_for_another():
    done, held, began = [], threading.Event(), threading.Event()

    def hold():
        began.set()
        held.wait(5.0)
        done.append("slow 0")

    with ThreadPoolExecutor(2) as pool:
        lines = Lines(pool)
        slow = [lines.add("slow", hold), lines.add("slow", lambda: done.append("slow 1"))]
        began.wait(5.0)
        quick = [lines.add("quick", lambda k=k: done.append(f"quick {k}")) for k in range(5)]
        for future in quick:
            future.result(5.0)
        held.set()
        for future in slow:
            future.result(5.0)
    assert done == [*(f"quick {k}" for k in range(5)), "slow 0", "slow 1"]


def test_many_lines_on_few_threads_never_run_two_of_one_line_at_a_time():
    running, order, most = set(), {}, []

    def work(line, k):
        assert line not in running
        running.add(line)
        most.append(len(running))
        time.sleep(0.0005)
        order.setdefault(line, []).append(k)
        running.discard(line)

    with ThreadPoolExecutor(3) as pool:
        lines = Lines(pool)
        futures = [lines.add(f"{n}", lambda n=n, k=k: work(n, k)) for k in range(20) for n in range(7)]
        for future in futures:
            future.result(5.0)
    assert all(order[n] == list(range(20)) for n in range(7)) and max(most) <= 3


def test_an_error_is_told_where_the_result_is_taken_and_the_line_goes_on():
    with ThreadPoolExecutor(1) as pool:
        lines = Lines(pool)
        bad, good = lines.add("a", lambda: 1 // 0), lines.add("a", lambda: 7)
        with pytest.raises(ZeroDivisionError):
            bad.result(5.0)
        assert good.result(5.0) == 7
