"""One suite over every row of the table: what each stage must do whatever it computes."""

import pickle
import random
from dataclasses import replace
from functools import cache

import captures
import numpy as np
import pytest
from stage_cases import NAMES, Case, cases, chain, content, free_views, views

from panoptic_ros.domain import DetectionSet, EndOfStream, Rig
from panoptic_ros.graph.build import config_class, configure, resolve
from panoptic_ros.graph.host import Host, lanes_of
from panoptic_ros.graph.nodes import FUSION, NODES
from panoptic_ros.graph.pipeline import Pipeline, records_of
from panoptic_ros.graph.topics import TOPICS, owner_of
from panoptic_ros.params import load, to_mapping
from panoptic_ros.stage import Stage, StageContext


def run(stage, items):
    results = [stage.step(item) for item in items] + [stage.flush()]
    return [output for result in results for output in result.outputs]


def all_of(stage, items):
    return content(tuple(run(stage, items)))


def topic_of(spec, item):
    """The port's topic that carries a record."""
    return next(port.topic for port in spec.inputs if TOPICS[port.topic].record == type(item).__name__)


def test_tables_resolve_and_every_record_has_its_topic():
    for spec in NODES.values():
        assert config_class(spec.name)() is not None and resolve(spec.stage) is not None
        owner, _, switch = spec.switch.rpartition(".")
        assert not switch or isinstance(getattr(config_class(owner or spec.name)(), switch), bool)
    with pytest.raises(KeyError, match="EndOfStream"):
        NODES["sync"].output_for(EndOfStream("a"))


@pytest.mark.parametrize("name", NAMES)
class TestStage:
    def test_fulfils_the_protocol_and_gives_its_records(self, name):
        case = cases()[name]
        spec, stage = NODES[case.name], case.stage()
        assert isinstance(stage, Stage)
        outputs = run(stage, case.items)
        assert outputs
        assert {spec.output_for(output) for output in outputs} <= set(spec.outputs)
        taken = {type(item).__name__ for item in case.items} - {"EndOfStream"}
        assert taken <= {TOPICS[port.topic].record for port in spec.inputs}

    def test_same_input_same_output(self, name):
        case = cases()[name]
        assert all_of(case.stage(), case.items) == all_of(case.stage(), case.items)

    def test_reset_and_flush_leave_it_as_new(self, name):
        case = cases()[name]
        expected, stage = all_of(case.stage(), case.items), case.stage()
        for item in case.items[: len(case.items) // 2]:
            stage.step(item)
        stage.reset()
        assert all_of(stage, case.items) == expected
        assert all_of(stage, case.items) == expected

    def test_inputs_stay_untouched_and_outputs_are_read_only(self, name):
        case = cases()[name]
        before = content(tuple(case.items))
        outputs = run(case.stage(), case.items)
        assert content(tuple(case.items)) == before
        for output in outputs:
            for slot in [s for cls in type(output).__mro__ for s in getattr(cls, "__slots__", ())]:
                value = getattr(output, slot)
                assert not isinstance(value, np.ndarray) or not value.flags.writeable

    def test_flush_of_a_new_stage_gives_nothing(self, name):
        assert cases()[name].stage().flush().outputs == ()

    def test_config_survives_plain_values_and_other_processes(self, name):
        case = cases()[name]
        config = configure({case.name: case.values})[case.name]
        assert load(type(config), to_mapping(config)) == config
        assert pickle.loads(pickle.dumps(config)) == config


# named by their stages: cases are made when a test needs them, not where tests are collected
IN_ORDER = tuple(
    name for name in NAMES if name.split("-")[0] not in ("clocks", "health", "offsets", "timecode")
)


@pytest.mark.parametrize("name", IN_ORDER)
def test_stamps_never_go_back(name):
    """Of the records of a camera or the graph; clock models and timecode are of other times, rigs of none."""
    newest = {}
    for output in run(cases()[name].stage(), cases()[name].items):
        owner = getattr(output, "camera", "")
        assert output.stamp_ns >= newest.get(owner, 0)
        newest[owner] = output.stamp_ns


# ------------------------------------------------------------------ whatever arrives first


def lanes_of_case(case):
    """The records of every topic and owner, in their order."""
    spec, lanes = NODES[case.name], {}
    for item in case.items:
        topic = topic_of(spec, item)
        lanes.setdefault((topic, owner_of(topic, item)), []).append(item)
    return lanes


def hosted(case, seed):
    """What a stage gives in a host, where topics arrive in an order that chance chooses."""
    found, lanes = [], lanes_of_case(case)
    configs = configure({case.name: case.values})
    pipeline = Pipeline(
        configs, case.context, [case.name], on_record=lambda topic, record: found.append(record)
    )
    owners = {topic: [owner for key, owner in lanes if key == topic] for topic, _ in lanes}
    host = Host(pipeline, lanes_of(list(owners), lambda topic: owners[topic], pipeline))
    chance, left = random.Random(seed), {key: list(items) for key, items in lanes.items()}
    while left:
        key = chance.choice(sorted(left))
        if left[key]:
            item = left[key].pop(0)
            host.put(*key, item.stamp_ns, item)
        else:
            del left[key]
            host.end(*key)
        host.advance()
    assert host.over
    return found


def shuffled_cases():
    """Cases without what has no place of its own: clock models and tracks, which come with markers."""
    plain = cases()
    return {
        **{name: plain[name] for name in ("timecode", "detection", *FUSION)},
        "association": Case("association", {}, chain()["detection_sets"], ()),
        "sync": Case("sync", {"window_s": 0.005}, views(), ()),
        "sync-interpolated": Case("sync", {"resampling": "interpolate"}, views(), ()),
        "continuous": Case("continuous", {"active": True}, free_views(), ()),
    }


@pytest.mark.parametrize(
    "name", ["timecode", "detection", *FUSION, "sync", "sync-interpolated", "continuous"]
)
def test_the_order_of_arrival_does_not_matter(name):
    case = shuffled_cases()[name]
    expected = sorted(map(repr, map(content, hosted(case, 0))))
    if not NODES[case.name].apart:  # there only the order within a camera or device counts
        assert content(tuple(hosted(case, 1))) == content(tuple(hosted(case, 0)))
    for seed in (1, 2, 3):
        assert sorted(map(repr, map(content, hosted(case, seed)))) == expected
    assert expected


# ------------------------------------------------------------------ the chain


def skeletons(items, context=captures.CONTEXT):
    return records_of("skeletons", items, configure({}), context)


@cache
def sets():
    configs = configure({"sync": {"window_s": 0.005}})
    return tuple(records_of("detection_sets", captures.views(), configs, captures.CONTEXT, ["sync"]))


def people_only(item):
    """The set without anybody in any view."""
    empty = tuple(
        replace(v, points=v.points[:0], scores=v.scores[:0], person_scores=v.person_scores[:0])
        for v in item.views
    )
    return replace(item, views=empty)


@pytest.mark.parametrize("change", [people_only, lambda item: replace(item, views=())])
def test_nobody_and_no_views_pass_through_the_whole_chain(change):
    items = skeletons([change(item) for item in sets()])
    assert len(items) == len(sets())
    assert all(len(item.ids) == 0 for item in items)


def test_people_are_found_exactly_and_keep_their_ids():
    outputs = skeletons(sets())
    ids = {tuple(sorted(item.ids.tolist())) for item in outputs}
    assert len(ids) == 1 and len(next(iter(ids))) == 2
    for item in outputs:
        truth = captures.people(item.stamp_ns * 1e-9)
        gaps = np.linalg.norm(item.positions[:, None] - truth[None], axis=-1).mean(-1)
        assert gaps.min(axis=1).max() < 0.01


def test_order_of_cameras_does_not_matter():
    """A rig in another order, with the views in that order, gives the same people."""
    order = [2, 0, 3, 1]
    context = StageContext(Rig(tuple(captures.RIG.cameras[i] for i in order)), captures.SKELETON)
    items = [
        DetectionSet(s.index, s.stamp_ns, s.skeleton_hash, tuple(s.views[i] for i in order)) for s in sets()
    ]
    for a, b in zip(skeletons(sets()), skeletons(items, context), strict=True):
        assert a.ids.tolist() == b.ids.tolist()
        assert np.nanmax(np.abs(a.positions - b.positions)) < 1e-3


def test_another_rig_is_taken_over_between_two_sets():
    """Cameras that were calibrated anew: ids stay, and stages that know cameras by name go on."""
    configs, found = configure({}), []
    pipeline = Pipeline(
        configs,
        captures.CONTEXT,
        FUSION,
        on_record=lambda topic, record: found.append(record) if topic == "skeletons" else None,
    )
    moved = replace(captures.RIG, frame_id="hall")
    for number, item in enumerate(sets()):
        if number == 6:
            assert pipeline.change_rig(moved) == ()
        pipeline.push("detection_sets", item)
    pipeline.flush()
    assert {tuple(item.ids.tolist()) for item in found} == {tuple(found[0].ids.tolist())}
    assert set(pipeline.change_rig(captures.RIG.subset(captures.RIG.names[:3]))) >= {"assembly"}
