"""Recordings of a live graph are whole, tell of themselves, survive a kill, and start on demand."""

import json
import re
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import captures
import numpy as np
import pytest
from recordings import write_bag

pytest.importorskip("rclpy")

from panoptic_ros.errors import EnvironmentProblem
from panoptic_ros.io.bag_recorder import BagRecorder, TopicCounter
from panoptic_ros.io.bags import BagReader
from panoptic_ros.io.definitions import described
from panoptic_ros.io.messages import bag_messages, image_message, to_message
from panoptic_ros.io.messages.family import bag_typestore
from panoptic_ros.io.salvage import repair
from panoptic_ros.running.plans.bag_plan import plan_bags
from panoptic_ros.running.recordings import control
from panoptic_ros.running.recordings import record as recording
from panoptic_ros.running.recordings.control import ask_all
from panoptic_ros.running.recordings.options import RecordOptions, Selection
from panoptic_ros.running.recordings.record import COUNTERS, FACTS

pytestmark = pytest.mark.ros
SECOND = 1_000_000_000


@pytest.fixture(autouse=True)
def state(tmp_path_factory, monkeypatch):
    """Takes that one test leaves open are not named in the next."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))


def panoptic(*words):
    """A `panoptic` of its own."""
    command = [sys.executable, "-u", "-m", "panoptic_ros.cli.main", *map(str, words)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def line_of(process, pattern):
    """The next line that matches."""
    for line in process.stdout:
        if re.search(pattern, line):
            return line
    raise AssertionError(f"it ended without {pattern!r}")


@pytest.fixture(scope="class")
def graph(tmp_path_factory):
    """A graph that publishes people, as long as it is needed."""
    bag = write_bag(tmp_path_factory.mktemp("people") / "bag", captures.views(60))
    process = panoptic("replay", bag, "--loops", 0)
    yield process
    process.send_signal(signal.SIGINT)
    process.wait(20)


def cdr(message):
    return bytes(bag_typestore().serialize_cdr(message, message.__msgtype__))


@pytest.mark.usefixtures("graph")
class TestGraph:
    def test_a_recording_runs_by_itself_and_tells_of_itself(self, tmp_path):
        recorder = panoptic("record", "--out", tmp_path / "take", "--duration", 2)
        told = recorder.communicate(timeout=60)[0]
        assert recorder.returncode == 0, told
        assert "GB" in told and re.search(r"/cam0/detections +\d+ +30", told)
        plan = plan_bags([tmp_path / "take"])
        assert plan.rig.names == captures.RIG.names and plan.skeleton.hash == captures.SKELETON.hash
        with BagReader(tmp_path / "take") as bag:
            rows = [(topic, message) for topic, _, message in bag.messages(FACTS, COUNTERS)]
            quality = bag.connection("/rig").qualities[0]
        facts, counters = json.loads(rows[0][1].data), json.loads(rows[-1][1].data)
        assert (rows[0][0], rows[-1][0]) == (FACTS, COUNTERS) and facts["versions"]["panoptic_ros"]
        assert "/replay" in facts["nodes"] and facts["format"] == "panoptic-recording-1"
        assert counters["/cam0/detections"]["count"] > 30
        assert counters["/cam0/detections"]["missing"] == 0
        assert quality.durability.name == "TRANSIENT_LOCAL"

    def test_parts_of_a_recording_have_what_a_run_needs(self, tmp_path):
        recorder = panoptic("record", "--out", tmp_path / "day", "--split", "1s", "--duration", 2.5)
        told = recorder.communicate(timeout=60)[0]
        assert recorder.returncode == 0, told
        parts = sorted((tmp_path / "day").iterdir())
        assert len(parts) >= 2 and plan_bags([parts[1]]).rig.names == captures.RIG.names
        with BagReader(parts[1]) as bag:
            assert bag.counts[FACTS] >= 1 and bag.counts["/cam0/detections"] > 5

    def test_a_killed_recorder_leaves_what_repairs(self, tmp_path):
        recorder = panoptic("record", "--out", tmp_path / "take")
        file = tmp_path / "take" / "take.mcap"
        end = time.monotonic() + 40
        while time.monotonic() < end and not (file.exists() and file.stat().st_size > 60_000):
            time.sleep(0.1)
        recorder.send_signal(signal.SIGKILL)
        recorder.wait()
        made = repair(tmp_path / "take", tmp_path / "whole")
        assert made.counts["/rig"] >= 1 and made.counts["/cam0/detections"] > 10
        assert plan_bags([tmp_path / "whole"]).rig.names == captures.RIG.names

    def test_recorders_start_and_stop_on_demand(self, tmp_path):
        recorder = panoptic("record", "--standby", "--out", tmp_path / "takes")
        try:
            line_of(recorder, "^waiting")
            ((host, done, text),) = ask_all(True, 2.0)
            assert host.startswith("recorder_") and done and text.startswith("recording /"), text
            ((_, done, text),) = ask_all(True, 2.0)
            assert done and "already" in text
            ((_, done, text),) = ask_all(False, 2.0)
            assert done and re.search(r"\d+ messages, 0 did not", text), text
            assert ask_all(False, 2.0) == [(host, True, text)]
            (take,) = (tmp_path / "takes").iterdir()
            with BagReader(take) as bag:
                assert bag.counts["/cam0/detections"] > 10 and bag.counts["/rig"] >= 1
        finally:
            recorder.send_signal(signal.SIGINT)
            told = recorder.communicate(timeout=20)[0]
            print(told)
        assert recorder.returncode == 0, told


class Started:
    """A recorder whose bag begins while the service is asked again."""

    def __init__(self, folder, monkeypatch, asked_meanwhile):
        self.lines, self.asked = [], []
        monkeypatch.setattr(recording, "recording_facts", self._facts)
        self._meanwhile = asked_meanwhile
        self._recording = recording._BagRecording(RecordOptions(), self.lines.append)
        self._folder = folder

    def _facts(self, node, executor):
        self.ask(self._meanwhile)
        return {}

    def ask(self, start):
        answer = self._recording._asked(SimpleNamespace(data=start), SimpleNamespace())
        self.asked.append((answer.success, answer.message))

    def run(self):
        with self._recording as running:
            running.serve(self._folder)
            self.ask(True)
            running.spin(lambda: False, 0.3)
            running.end()


@pytest.mark.parametrize("start", [True, False])
def test_a_recorder_that_is_asked_while_it_begins_makes_one_bag(tmp_path, monkeypatch, start):
    started = Started(tmp_path, monkeypatch, start)
    started.run()
    (_, (done, text)) = started.asked
    assert done and ("already" in text) is start
    (bag,) = tmp_path.iterdir()
    with BagReader(bag) as reader:
        assert reader.counts[FACTS] == 1 and reader.counts[COUNTERS] == 1
    assert len(started.lines) == (1 if start else 2)


def test_a_recorder_stands_by_after_a_bag_that_cannot_begin(tmp_path, monkeypatch):
    (tmp_path / "takes").write_text("no folder")
    started = Started(tmp_path / "takes", monkeypatch, True)
    started.run()
    assert len(started.lines) == 1 and "takes" in started.lines[0]


def test_two_bags_that_begin_within_a_second_have_names_of_their_own(tmp_path, monkeypatch):
    monkeypatch.setattr(recording, "recording_facts", lambda node, executor: {})
    monkeypatch.setattr(recording.time, "strftime", lambda *_: "20261124-090000")
    standing = recording._BagRecording(RecordOptions(), lambda line: None)

    def ask(start):
        return standing._asked(SimpleNamespace(data=start), SimpleNamespace()).message

    with standing:
        standing.serve(tmp_path)
        assert ask(False) == "was not recording"
        for _ in range(3):
            ask(True)
            standing.spin(lambda: False, 0.1)
            ask(False)
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "20261124-090000",
        "20261124-090000-2",
        "20261124-090000-3",
    ]


class LateRecorder:
    """A recorder that appears late, and whose first answer never comes."""

    def __init__(self, after_s):
        self.after_s, self.began, self.wishes = after_s, time.monotonic(), []

    def get_service_names_and_types(self):
        found = time.monotonic() > self.began + self.after_s
        return [("/recorder_a/record", ["std_srvs/srv/SetBool"])] if found else []

    def create_client(self, kind, name):
        return self

    def service_is_ready(self):
        return True

    def call_async(self, request):
        self.wishes.append(request.data)
        answer = SimpleNamespace(success=True, message=f"answer {len(self.wishes)}")
        lost = len(self.wishes) == 1
        return SimpleNamespace(done=lambda: not lost, result=lambda: answer)

    def destroy_node(self):
        pass


def test_a_recorder_that_is_found_late_and_loses_an_answer_is_asked_again(monkeypatch):
    late = LateRecorder(0.4)
    monkeypatch.setattr(control, "SETTLE_S", 0.05)
    monkeypatch.setattr(control, "AGAIN_S", 0.1)
    monkeypatch.setattr(control.rclpy, "create_node", lambda name: late)
    monkeypatch.setattr(control, "start_ros", lambda words: None)
    monkeypatch.setattr(control, "SingleThreadedExecutor", NoExecutor)
    assert ask_all(True, 0.1) == [("recorder_a", True, "answer 2")]
    assert late.wishes == [True, True]


class NoExecutor:
    def add_node(self, node):
        pass

    def spin_once(self, timeout_sec):
        time.sleep(timeout_sec)

    def shutdown(self):
        pass


def test_no_recorder_is_told(monkeypatch):
    monkeypatch.setattr(control, "ANSWER_S", 0.2)
    with pytest.raises(EnvironmentProblem, match="no recorder is standing by"):
        ask_all(True, 0.1)


def test_nothing_to_record_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(recording, "PATIENCE_S", 0.2)
    with pytest.raises(EnvironmentProblem, match="no node publishes a topic to record"):
        recording.record(tmp_path / "take", RecordOptions(), lambda line: None)
    assert not list(tmp_path.iterdir())


def test_missing_frames_are_counted_by_their_numbers_and_by_their_stamps():
    numbered = TopicCounter("panoptic_msgs/msg/ViewDetections")
    for view in captures.views(20):
        if view.camera == "cam0" and view.frame_number not in (5, 6, 11):
            numbered.add(cdr(to_message(view, bag_messages())))
    assert (numbered.count, numbered.missing) == (17, 3)
    assert numbered.rate == pytest.approx(30 * 16 / 19, rel=1e-6)

    stamped = TopicCounter("sensor_msgs/msg/Image")
    from panoptic_ros.domain import ViewFrame

    for k in range(60):
        if k not in (30, 31, 50):
            frame = ViewFrame("left", SECOND + k * SECOND // 25, k, np.zeros((2, 2, 3), np.uint8))
            stamped.add(cdr(image_message(frame, bag_messages())))
    assert (stamped.count, stamped.missing) == (57, 3)
    assert stamped.longest_s == pytest.approx(0.12)


def test_a_budget_ends_a_recording_that_is_whole(tmp_path):
    recorder = BagRecorder(tmp_path / "take", budget=200_000, keep_free=0)
    connection = described("/text", "std_msgs/msg/String")
    end = time.monotonic() + 20
    while recorder.fault is None and time.monotonic() < end:
        recorder.put(connection, 5, bytes(10_000))
        time.sleep(0.01)
    recorder.close()
    assert "budget" in str(recorder.fault)
    with BagReader(tmp_path / "take") as bag:
        assert bag.counts["/text"] >= 20


def test_what_a_run_needs_is_chosen():
    chosen = Selection()
    assert chosen.wants("/hall/cam0/detections", "panoptic_msgs/msg/ViewDetections")
    assert chosen.wants("/skeletons", "panoptic_msgs/msg/Skeletons")
    assert not chosen.wants("/skeletons_raw", "panoptic_msgs/msg/Skeletons")
    assert not chosen.wants("/rosout", "rcl_interfaces/msg/Log")
    assert not Selection(images=False).wants("/a", "sensor_msgs/msg/Image")
    assert Selection(["/ro*"]).wants("/rosout", "rcl_interfaces/msg/Log")
