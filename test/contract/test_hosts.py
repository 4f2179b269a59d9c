"""In one process and in the standard graph, and whatever arrives first, stages take the same.

The graph is of toy stages with all that a table can hold: two inputs of one camera, a third input, several
outputs, images again after 3D, ends that are told, feedback to two stages, one loop within the other.
"""

import random

import pytest
import toy_graph
from hypothesis import given, settings
from hypothesis import strategies as st
from toy_graph import OWNERS, TABLE, Group, Known, Transport, View, Wide

from panoptic_ros.graph import topics
from panoptic_ros.graph.build import rows_in_use
from panoptic_ros.graph.nodes import BESIDE_IMAGES, NODES, Port
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.graph.schedule import StageSchedule
from panoptic_ros.graph.topics import number_of
from panoptic_ros.graph.wiring import Wiring
from panoptic_ros.stage import StageContext


@pytest.fixture(autouse=True, scope="module")
def toy_topics():
    with pytest.MonkeyPatch.context() as patch:
        for number, (key, topic) in enumerate(toy_graph.TOY_TOPICS.items(), start=len(topics.TOPICS)):
            patch.setitem(topics.TOPICS, key, topic)
            patch.setitem(topics._NUMBERS, key, number)
        yield


def context(logs):
    return StageContext(None, None, {"logs": logs})


def capture(seed):
    """Views of three cameras with unequal stamps, and wide ones beside some of them."""
    chance, found = random.Random(seed), []
    for place, camera in enumerate(OWNERS):
        stamp = 1000 + 3 * place
        for number in range(chance.randint(0 if seed % 5 == 0 else 2, 7)):
            stamp += chance.choice([100, 100, 130, 700_000_000 if seed % 4 == 0 else 100])
            found.append(("view", View(stamp, f"{camera}{number}", camera)))
            if chance.random() < 0.5:
                found.append(("wide", Wide(stamp + chance.randint(-4, 4), f"{camera}{number}", camera)))
    return found


def run(parts, seed, order):
    """What every stage took, where the stages are divided so."""
    transport, records = Transport(parts, context, order), capture(seed)
    for topic, record in records:
        transport.feed(topic, record)
    for topic in ("view", "wide"):
        for camera in OWNERS:
            sent = sum(key == topic and record.camera == camera for key, record in records)
            transport.feed_end(topic, camera, sent)
    transport.run()
    assert all(host.over for host in transport.hosts)
    logs = transport.logs
    return {**logs, "Looker": sorted(logs.get("Looker", ()))}, transport.results


ONE = [list(TABLE)]
STANDARD = [["looker"], [name for name in TABLE if name != "looker"]]


@settings(max_examples=80, deadline=None)
@given(parts=st.sampled_from([ONE, STANDARD]), seed=st.integers(0, 200), order=st.integers(0, 1000))
def test_one_process_and_the_standard_graph_take_the_same(parts, seed, order):
    assert run(parts, seed, order) == run(ONE, seed, 0)


def test_a_stage_takes_what_comes_back_from_another_process_as_it_comes():
    """Live, one node per stage: nobody waits for feedback, and none of it waits for the next record."""
    logs = {}
    pipeline = Pipeline(
        toy_graph.CONFIGS, context(logs), ["linker"], everywhere=["linker", "knower"], table=TABLE
    )
    for number in range(3):
        pipeline.push("group", Group(number, f"g{number}"))
        pipeline.push("known", Known(number, f"k{number}"))
    assert logs["Linker"] == ["Group g0", "Known k0", "Group g1", "Known k1", "Group g2", "Known k2"]


def test_records_that_are_pushed_one_by_one_are_taken_as_in_a_replay():
    """`Pipeline.push` in the order of stamps, without ends: what a live host and `solve` do."""
    records = [(key, r) for key, r in capture(3) if key == "view"]
    logs = {}
    pipeline = Pipeline(toy_graph.CONFIGS, context(logs), TABLE, table=TABLE)
    for _, record in sorted(records, key=lambda row: row[1].stamp_ns):
        pipeline.push("view", record)
    taken = [text for text in logs["Patcher"] if text.startswith("View")]
    assert taken == [f"View {r.text}" for _, r in sorted(records, key=lambda row: row[1].stamp_ns)]
    assert any(text.startswith("Hint") for text in logs["Grouper"])


def test_what_comes_back_is_taken_before_the_next_record():
    logs = {}
    pipeline = Pipeline(toy_graph.CONFIGS, context(logs), TABLE, table=TABLE)
    for number in range(12):
        pipeline.push("view", View(1000 * number, f"v{number}", "x"))
    for before, text in zip(logs["Linker"], logs["Linker"][1:]):
        if text.startswith("Known"):  # of the group before it
            assert before.split()[1].split("/")[0] == text.split()[1].split("/")[0]


@pytest.mark.parametrize("cut", [1, 7, 11, 18])
def test_the_state_of_a_pipeline_goes_on_in_another(cut):
    views = [View(1000 * number, f"v{number}", "x") for number in range(20)]
    whole, parts, state = {}, {}, {}
    pipeline = Pipeline(toy_graph.CONFIGS, context(whole), TABLE, table=TABLE)
    for view in views:
        pipeline.push("view", view)
    for part in (views[:cut], views[cut:]):
        pipeline = Pipeline(toy_graph.CONFIGS, context(parts), TABLE, table=TABLE)
        pipeline.begin(state)
        for view in part:
            pipeline.push("view", view)
        state = pipeline.state()
    assert parts == whole


def test_the_table_is_in_order():
    for table in (NODES, TABLE):
        rows = list(table.values())
        for place, spec in enumerate(rows):
            below = {topic for row in rows[place:] for topic in row.outputs}
            assert not [port for port in spec.inputs if port.topic in below and not port.feedback]


def test_every_topic_of_a_row_is_in_the_table_and_its_marks_fit():
    for spec in NODES.values():
        for port in spec.inputs:
            assert isinstance(port, Port) and port.topic in topics.TOPICS
            assert port.latched == topics.TOPICS[port.topic].latched
            assert not port.latched or port.optional  # nobody can wait for what may never come
        assert set(spec.outputs) <= set(topics.TOPICS)
        kinds = [topics.TOPICS[key].record for key in spec.outputs]
        assert len(set(kinds)) == len(kinds)  # a record goes to the topic of its type


def test_only_offsets_comes_back_to_sync_and_tracking_to_association():
    table = rows_in_use(())
    assert heads_of(Wiring(NODES, table=table)) == ["sync", "association"]
    others = [name for name in NODES if name not in ("offsets", "tracking")]
    assert Wiring(others, table=table).heads == frozenset()


def test_only_records_whose_stamps_tell_their_places_cross_the_standard_graph():
    assert all(topics.TOPICS[topic].by_stamp for topic in Wiring(BESIDE_IMAGES, NODES).leaving)
    rest = Wiring([name for name in NODES if name not in BESIDE_IMAGES])
    assert [port for port in rest.inputs if not (topics.TOPICS[port.topic].by_stamp or port.latched)] == []
    assert not Wiring(BESIDE_IMAGES, NODES, rows_in_use(())).heads


def test_tracking_comes_back_to_detection_where_it_looks_at_regions():
    table = rows_in_use(("detection.tracks",))
    assert heads_of(Wiring(NODES, table=table)) == ["detection", "sync", "association"]
    assert rows_in_use(())["detection"].apart and not table["detection"].apart


def test_what_comes_back_to_a_stage_is_taken_before_its_next_record_also_if_stamps_tell_places():
    wiring = Wiring(("detection", "sync", "tracking"), NODES, rows_in_use(("detection.tracks",)))
    schedule = StageSchedule(wiring)
    for owner in (0, 1):
        schedule.add("image", f"image {owner}", (100, owner, number_of("image")))
    turn = schedule.next(None)
    place = schedule.place_of_next(turn, "detections")
    schedule.add("detections", "people", place, turn.stage)
    following = schedule.next(None)
    assert (turn.record, following.record) == ("image 0", "people")
    schedule.add("tracks", "tracks", (*following.time, 1), 2)
    assert [schedule.next(None).record for _ in range(2)] == ["tracks", "image 1"]


def heads_of(wiring):
    return [wiring.specs[number].name for number in sorted(wiring.heads)]
