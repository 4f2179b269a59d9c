"""Latencies are those of the instants that the skeletons are of; what never came is lost."""

from types import MappingProxyType

import numpy as np
import pytest

from panoptic_ros.study.live.graph_figures import FloodRecord, Observation, Usage, figures_of

MS = 1_000_000
FROM = 100_000 * MS  # stamps are on another clock


def observed(received, diagnostics=MappingProxyType({})):
    """Ten instants, 30 ms apart, last views published 5 ms after the stamp; the first four do not count."""
    sent = [(FROM + 30 * MS * k, 30 * MS * k + 5 * MS) for k in range(10)]
    before, after = Usage(120 * MS, 1.0, 80.0), Usage(320 * MS, 1.1, 81.5)
    return figures_of(Observation(sent, received, 30 * MS, -1000 * MS, 120 * MS, before, after, diagnostics))


def answers(latency_ms):
    """Skeletons with a stamp between those of the first and the last view."""
    return [
        (FROM + 30 * MS * k + 3 * MS, 30 * MS * k + 5 * MS + round(MS * latency))
        for k, latency in latency_ms.items()
    ]


def test_every_answer_in_time():
    latencies = {0: 900.0, **{k: 10.0 + k for k in range(4, 10)}}
    found = observed(answers(latencies))
    assert (found["sent"], found["received"], found["lost"]) == (6, 6, 0)
    assert found["latency_p50_ms"] == pytest.approx(np.median(np.arange(14.0, 20.0)))
    assert found["latency_max_ms"] == pytest.approx(19.0)
    assert found["first_skeletons_s"] == pytest.approx(1.0 + 0.139)  # of instant 4, before the late one of 0
    assert found["cpu_percent"] == pytest.approx(50.0) and found["growth_mb"] == pytest.approx(1.5)


def test_what_does_not_come_is_lost_and_what_comes_twice_counts_once():
    twice = answers({5: 8.0, 7: 9.0}) + answers({7: 20.0})
    found = observed(twice)
    assert (found["sent"], found["received"], found["lost"]) == (6, 2, 4)
    assert found["latency_max_ms"] == pytest.approx(9.0)


def test_skeletons_of_no_instant_that_was_sent_are_no_answer():
    strange = [(FROM + 3000 * MS, 3010 * MS)]
    found = observed(strange)
    assert found["received"] == 0 and found["latency_p99_ms"] is None


def test_steps_and_drops_are_those_of_the_diagnostics():
    told = {"sync": {"step_p50_ms": "0.250", "dropped.queue_full": "3"}, "markers": {}}
    found = observed(answers({5: 8.0}), told)
    assert found["steps_ms"] == {"sync": 0.25} and found["dropped"] == {"sync.queue_full": 3}


def test_a_flood_costs_instants_and_moves_stamps():
    sent = [(FROM + 30 * MS * k, 30 * MS * k) for k in range(10)]
    received = [(stamp, when + 8 * MS) for k, (stamp, when) in enumerate(sent) if k not in (4, 5)]
    received.append((FROM + 9000 * MS, 200 * MS))
    usage = Usage(0, 1.0, 80.0)
    floods = [FloodRecord("cam00", 99, 60 * MS, 215 * MS)]
    observation = Observation(
        sent,
        sorted(received, key=lambda pair: pair[1]),
        30 * MS,
        0,
        0,
        usage,
        Usage(300 * MS, 1.0, 80.0),
        {},
        (),
        floods,
    )
    (found,) = figures_of(observation)["floods"]
    assert found == {
        "title": "cam00",
        "messages": 99,
        "instants": 6,
        "lost": 2,
        "odd_stamps": 1,
        "longest_gap_s": pytest.approx(0.09),
    }
