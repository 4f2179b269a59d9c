"""One suite over every stage of the chain: what each must do whatever it computes."""
import pickle
from dataclasses import replace
from itertools import pairwise

import captures
import numpy as np
import pytest

from panoptic_ros.domain import DetectionSet, Rig
from panoptic_ros.graph.build import config_class, configure, make_stage, resolve
from panoptic_ros.graph.nodes import FUSION, NODES
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.params import load, to_mapping
from panoptic_ros.stage import Stage, StageContext

CONFIGS = configure({"sync": {"window_s": 0.005}})
CHAIN = ("sync", *FUSION)


def fresh(name, context=captures.CONTEXT):
    return make_stage(name, CONFIGS[name], context)


def run(stage, items):
    results = [stage.step(item) for item in items] + [stage.flush()]
    return [output for result in results for output in result.outputs]


def inputs():
    """What each stage of the chain takes, from an exact capture."""
    items, table = captures.views(), {}
    for name in CHAIN:
        table[name] = items
        items = run(fresh(name), items)
    return table


INPUTS = inputs()


def content(record):
    """A record as bytes, deeply."""
    if isinstance(record, np.ndarray):
        return record.shape, record.dtype.str, record.tobytes()
    if isinstance(record, tuple):
        return tuple(content(item) for item in record)
    names = [n for cls in type(record).__mro__ for n in getattr(cls, "__slots__", ())]
    if names:
        return type(record).__name__, tuple((n, content(getattr(record, n))) for n in names)
    return record


def test_tables_resolve_and_neighbours_agree():
    for spec in NODES.values():
        assert spec.gives in TOPICS and all(key in TOPICS for key in spec.takes)
        assert config_class(spec.name)() is not None and resolve(spec.stage) is not None
    for name, following in pairwise(CHAIN):
        assert NODES[following].takes == (NODES[name].gives,)


@pytest.mark.parametrize("name", CHAIN)
class TestStage:
    def test_fulfils_the_protocol_and_gives_its_record(self, name):
        stage = fresh(name)
        assert isinstance(stage, Stage)
        outputs = run(stage, INPUTS[name])
        assert outputs
        assert {type(output).__name__ for output in outputs} == {TOPICS[NODES[name].gives].record}

    def test_same_input_same_output(self, name):
        assert content(tuple(run(fresh(name), INPUTS[name]))) == content(
            tuple(run(fresh(name), INPUTS[name]))
        )

    def test_reset_and_flush_leave_it_as_new(self, name):
        expected = content(tuple(run(fresh(name), INPUTS[name])))
        stage = fresh(name)
        for item in INPUTS[name][:7]:
            stage.step(item)
        stage.reset()
        assert content(tuple(run(stage, INPUTS[name]))) == expected
        assert content(tuple(run(stage, INPUTS[name]))) == expected

    def test_inputs_stay_untouched_and_outputs_are_read_only(self, name):
        before = content(tuple(INPUTS[name]))
        outputs = run(fresh(name), INPUTS[name])
        assert content(tuple(INPUTS[name])) == before
        for output in outputs:
            for slot in [s for cls in type(output).__mro__ for s in getattr(cls, "__slots__", ())]:
                value = getattr(output, slot)
                assert not isinstance(value, np.ndarray) or not value.flags.writeable

    def test_stamps_never_go_back(self, name):
        stamps = [output.stamp_ns for output in run(fresh(name), INPUTS[name])]
        assert stamps == sorted(stamps)

    def test_flush_of_a_new_stage_gives_nothing(self, name):
        assert fresh(name).flush().outputs == ()

    def test_config_survives_plain_values(self, name):
        values = to_mapping(CONFIGS[name])
        assert load(type(CONFIGS[name]), values) == CONFIGS[name]


def people_only(item):
    """The set without anybody in any view."""
    empty = tuple(
        replace(v, points=v.points[:0], scores=v.scores[:0], person_scores=v.person_scores[:0])
        for v in item.views
    )
    return replace(item, views=empty)


@pytest.mark.parametrize("change", [people_only, lambda item: replace(item, views=())])
def test_nobody_and_no_views_pass_through_the_whole_chain(change):
    items = [change(item) for item in INPUTS["voting"]]
    for name in FUSION:
        items = run(fresh(name), items)
        assert len(items) == len(INPUTS["voting"])
    assert all(len(item.ids) == 0 for item in items)


def test_people_are_found_exactly_and_keep_their_ids():
    outputs = run(fresh("refinement"), INPUTS["refinement"])
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
        DetectionSet(s.index, s.stamp_ns, s.skeleton_hash, tuple(s.views[i] for i in order))
        for s in INPUTS["voting"]
    ]
    expected = INPUTS["voting"]
    for name in FUSION:
        expected, items = run(fresh(name), expected), run(fresh(name, context), items)
    for a, b in zip(expected, items):
        assert a.ids.tolist() == b.ids.tolist()
        assert np.nanmax(np.abs(a.positions - b.positions)) < 1e-3


@pytest.mark.parametrize("name", CHAIN)
def test_configurations_can_be_sent_to_other_processes(name):
    assert pickle.loads(pickle.dumps(CONFIGS[name])) == CONFIGS[name]
