"""Live: a long look at one camera holds up neither the others nor the next instant.

What waits in lines: each in its order, all side by side.
"""

import queue
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import captures
import numpy as np
import pytest

from panoptic_ros.domain import ViewFrame
from panoptic_ros.errors import DataError
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.flow import BUSY, make_flow
from panoptic_ros.graph.nodes import NODES
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.graph.queues import queue_for
from panoptic_ros.graph.under_way import INSTANTS, CameraTaskQueues, ParallelPipeline
from panoptic_ros.graph.wiring import Wiring
from panoptic_ros.stage import StepResult


def test_each_line_keeps_its_order_and_none_waits_for_another():
    done, held, began = [], threading.Event(), threading.Event()

    def hold():
        began.set()
        held.wait(5.0)
        done.append("slow 0")

    with ThreadPoolExecutor(2) as pool:
        lines = CameraTaskQueues(pool)
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
        lines = CameraTaskQueues(pool)
        futures = [lines.add(f"{n}", lambda n=n, k=k: work(n, k)) for k in range(20) for n in range(7)]
        for future in futures:
            future.result(5.0)
    assert all(order[n] == list(range(20)) for n in range(7)) and max(most) <= 3


def test_an_error_is_told_where_the_result_is_taken_and_the_line_goes_on():
    with ThreadPoolExecutor(1) as pool:
        lines = CameraTaskQueues(pool)
        bad, good = lines.add("a", lambda: 1 // 0), lines.add("a", lambda: 7)
        with pytest.raises(ZeroDivisionError):
            bad.result(5.0)
        assert good.result(5.0) == 7


CAMERAS = captures.RIG.names
TABLE = {**NODES, "detection": replace(NODES["detection"], stage=f"{__name__}:Looker")}
HELD: dict[tuple[str, int], threading.Event] = {}


class Looker:
    """Gives a view for every image; waits where it is held, and refuses images of number 99."""

    def __init__(self, config, context):
        pass

    def step(self, item):
        if (item.camera, item.frame_number) in HELD:
            HELD[item.camera, item.frame_number].wait(5.0)
        if item.frame_number == 99:
            raise DataError("refused")
        camera = captures.RIG.camera(item.camera)
        return StepResult((captures.view(camera, item.frame_number, item.stamp_ns),))

    def state(self):
        return b""


class Live:
    """A pipeline of detection, and what a node's worker does for it."""

    def __init__(self, pool):
        self.given, self.refused, self.calls = [], [], queue.Queue()
        self.pipeline = Pipeline(
            configure({}),
            captures.CONTEXT,
            ("detection",),
            table=TABLE,
            everywhere=("detection", "sync"),
            on_record=lambda topic, record: self.given.append((record.camera, record.frame_number)),
            on_refused=lambda stage, error: self.refused.append(str(error)),
        )
        self.under_way = ParallelPipeline(self.pipeline, pool, self.calls.put)

    def begin(self, number, cameras=CAMERAS):
        image = np.zeros((4, 4, 3), np.uint8)
        self.under_way.begin([("image", ViewFrame(c, number * 10**8, number, image)) for c in cameras])

    def work(self, count):
        for _ in range(count):
            self.calls.get(timeout=5.0)()


@pytest.fixture(autouse=True)
def nothing_held():
    HELD.clear()
    yield
    for event in HELD.values():
        event.set()


def test_a_long_look_holds_up_its_own_camera_alone():
    HELD[CAMERAS[0], 0] = threading.Event()
    with ThreadPoolExecutor(2) as pool:
        live = Live(pool)
        live.begin(0)
        assert not live.under_way.full
        live.begin(1)
        assert live.under_way.full and INSTANTS == 2
        live.work(2 * (len(CAMERAS) - 1))
        assert CAMERAS[0] not in {camera for camera, _ in live.given}
        for camera in CAMERAS[1:]:
            assert [number for name, number in live.given if name == camera] == [0, 1]
        HELD[CAMERAS[0], 0].set()
        live.work(2)
        assert [number for name, number in live.given if name == CAMERAS[0]] == [0, 1]
        assert not live.under_way.full


def test_what_is_refused_is_told_and_ends_its_instant():
    with ThreadPoolExecutor(2) as pool:
        live = Live(pool)
        live.begin(99)
        live.under_way.wait()
        live.work(len(CAMERAS))
        assert live.refused == ["refused"] * len(CAMERAS) and not live.given and not live.under_way.full


def test_without_a_pool_records_are_handed_on_at_once():
    live = Live(None)
    live.begin(3)
    assert live.given == [(camera, 3) for camera in CAMERAS] and not live.under_way.full


def test_no_instant_is_taken_while_there_are_enough():
    full = [True]
    live = Live(None)
    present = [("image", camera) for camera in CAMERAS]
    waiting = queue_for(live.pipeline.wiring, make_flow("live"), present, lambda: full[0])
    for camera in CAMERAS:
        waiting.put(f"image {camera}", 1, camera)
    assert waiting.take() == []
    full[0] = False
    assert waiting.take() == list(CAMERAS)


@pytest.mark.parametrize(("stages", "few"), [(["kinematics"], BUSY), (["kinematics", "refinement"], 2)])
def test_more_waits_for_a_stage_that_catches_up_than_for_others(stages, few):
    waiting = queue_for(Wiring(stages), make_flow("live"), [("imu", "back"), ("skeletons_raw", "")])
    dropped = {key: sum(waiting.put(key, k, k) for k in range(BUSY)) for key in ("imu back", "skeletons_raw")}
    assert dropped == {"imu back": 0, "skeletons_raw": BUSY - few}
    assert waiting.put("imu back", BUSY, BUSY) == 1
