"""Instants without skeletons are put down to the failure that they fall into."""

from panoptic_ros.study.live.failures import SECOND, Failure, SoakObservations, soak_figures

PERIOD = SECOND // 10
FROM = 5000 * SECOND


def test_lost_instants_have_causes_and_identities_are_compared():
    sent = [(FROM + k * PERIOD, k * PERIOD) for k in range(200)]
    missing = {20, 55, 56, 70, 110, 150}
    failures = [
        Failure("a camera died or came back", 2 * SECOND, 2 * SECOND),
        Failure("process sync was killed", round(5.45 * SECOND), 7 * SECOND),
    ]
    stamps = [stamp + PERIOD // 3 for k, (stamp, _) in enumerate(sent) if k not in missing]
    found = soak_figures(
        SoakObservations(
            sent,
            stamps,
            PERIOD,
            failures,
            frozenset({0, 1, 2}),
            frozenset({1, 2, 7}),
            {0: 9, 1: 9, 2: 9, 7: 3},
            [100.0, 101.0, 103.0, 104.0],
            {"sync.lost": 2},
            [(round(12.9 * SECOND), "sync.late"), (round(13.1 * SECOND), "sync.lost")],
        )
    )
    assert found["instants"] == 200 and found["lost"] == 6
    assert found["lost_by_cause"] == {
        "a camera died or came back": 1,
        "counted as sync.late": 1,
        "none of these": 1,
        "process sync was killed": 3,
    }
    assert (found["people"], found["kept"], found["identities"]) == (3, 2, 4)
    assert found["growth_mb"] == 1.0 and found["dropped"] == {"sync.lost": 2}
