"""Events of cameras and devices in the log: each once, whatever else happens; all are counted."""

from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

from panoptic_ros.cli.run.watch import TerminalObserver
from panoptic_ros.graph.counters import StageStatistics
from panoptic_ros.nodes.health.tally import CALM_S, NoticeLog
from panoptic_ros.stage import Notice


def lost(device, number):
    return Notice("timecode.gap", "warning", f"audio of {device} lost block {number}", {"device": device})


def test_an_event_is_told_once_for_each_device_and_again_after_calm():
    now, lines, statistics = [0.0], [], StageStatistics()
    log = NoticeLog(SimpleNamespace(warning=lines.append), statistics, lambda: now[0])
    for number in range(3):  # blocks are lost for a while
        for device in ("left", "right"):
            log.tell(lost(device, number))
        now[0] += 0.6 * CALM_S
    assert [line.split(" (")[0] for line in lines] == [
        "timecode.gap: audio of left lost block 0",
        "timecode.gap: audio of right lost block 0",
    ]
    now[0] += CALM_S
    log.tell(lost("left", 3))
    assert len(lines) == 3 and "left lost block 3" in lines[-1]
    values = statistics.values()
    assert values["notice.timecode.gap"] == "7"
    assert values["latest.timecode.gap"] == "audio of left lost block 3"
    assert values["latest.timecode.gap right"] == "audio of right lost block 2"
    assert statistics.warned == {"timecode.gap": 7}


def test_a_run_prints_what_is_odd_of_each_device_once(capsys):
    watch = TerminalObserver(table=False)
    for stamp in range(3):
        statistics = StageStatistics()
        for device in ("back", "arm"):
            text = f"{device} sends the stamp {stamp} twice"
            statistics.take(Notice("kinematics.imu_stamps", "warning", text, {"device": device}))
        watch.saw("diagnostics", {"kinematics": statistics.values()})
    told = [line for line in capsys.readouterr().err.splitlines() if line]
    assert told == ["warning: arm sends the stamp 0 twice", "warning: back sends the stamp 0 twice"]


def test_what_is_no_warning_is_counted_only():
    lines, statistics = [], StageStatistics()
    log = NoticeLog(SimpleNamespace(warning=lines.append), statistics)
    log.tell(Notice("sync.surplus_frame", "info", "text"))
    assert not lines and statistics.values()["notice.sync.surplus_frame"] == "1"
    assert "latest.sync.surplus_frame" not in statistics.values()
