"""What an audience costs: ratios with their intervals, told apart from chance."""

import numpy as np
import pytest

from panoptic_ros.study.live.view_figures import Phase, ages_of, ratio_of_p99, table_of


def phase(name, rng, factor=1.0, clients=()):
    blocks = [factor * rng.gamma(4.0, 2.0, 30) for _ in range(20)]
    return Phase(name, blocks, rng.gamma(4.0, 0.01, 90), 1, 5.0, 90.0, clients)


def test_an_interval_holds_the_ratio_and_tells_a_cost_from_chance():
    rng = np.random.default_rng(3)
    alike, dearer = ([phase("x", rng, factor) for _ in range(3)] for factor in (1.0, 1.5))
    blocks = [[block for each in some for block in each.blocks] for some in (alike, dearer)]
    nobody = [block for _ in range(3) for block in phase("nobody", rng).blocks]
    ratio, low, high = ratio_of_p99(blocks[0], nobody, rng)
    assert low < 1.0 < high and low <= ratio <= high
    ratio, low, high = ratio_of_p99(blocks[1], nobody, rng)
    assert low > 1.2 and ratio == pytest.approx(1.5, rel=0.2)
    assert np.isnan(ratio_of_p99([], nobody, rng)).all()


def test_a_table_has_nobody_first_with_what_chance_does():
    rng = np.random.default_rng(4)
    page = {
        "kind": "fast",
        "packets": 10,
        "age_p50_ms": 1.0,
        "age_p99_ms": 2.0,
        "age_max_ms": 3.0,
        "megabytes_per_s": 1.0,
        "skipped": 0,
    }
    slower = {**page, "age_p99_ms": 9.0}
    rows = table_of(
        [
            phase("one", rng, 2.0, [page, slower]),
            phase("nobody", rng),
            phase("nobody", rng),
            phase("one", rng, 2.0, [page]),
        ]
    )
    assert [row["audience"] for row in rows] == ["nobody", "one"]
    assert rows[0]["ratio_low"] < 1.0 < rows[0]["ratio_high"] and rows[1]["ratio_low"] > 1.5
    assert rows[1]["messages"] == 1200 and rows[1]["lost"] == 2
    assert rows[1]["clients"] == [{**slower, "packets": 30}]


def test_ages_count_from_the_publication():
    client = {
        "kind": "fast",
        "came": [(5, 3_000_000), (6, 9_000_000), (7, 1)],
        "megabytes_per_s": 1.0,
        "skipped": 2,
    }
    found = ages_of(client, {5: 1_000_000, 6: 5_000_000})
    assert found["packets"] == 2 and found["age_max_ms"] == 4.0 and found["age_p50_ms"] == 3.0
    assert ages_of({**client, "came": []}, {})["age_p99_ms"] is None
