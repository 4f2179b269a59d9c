"""Counts of nodes go on where they are started anew."""

from panoptic_ros.graph.counters import DropLog


def test_counts_go_on_over_restarts():
    log = DropLog()
    for now, count in enumerate((2, 2, 5, 1, 1, 4)):
        log.heard("sync", {"taken": "9", "dropped.late": str(count)}, now)
    log.heard("voting", {"dropped.late": "3", "dropped.bad_message": "0"}, 9)
    assert log.counts == {"sync.late": 2 + 3 + 1 + 3, "voting.late": 3}
    assert log.times == [*((now, "sync.late") for now in (0, 2, 3, 5)), (9, "voting.late")]
