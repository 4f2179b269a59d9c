"""Damaged messages on every input of every stage: refused by name, or taken without harm; never a crash.

Kernels trust indices, so what gets past `graph.entrance` and breaks one would end the process.
"""

import copy

import captures
import numpy as np
import pytest
from damage import damage
from stage_cases import NAMES, VALUES, cases, views

from panoptic_ros.domain import DepthFrame, EndOfStream, ViewFrame
from panoptic_ros.errors import DataError
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.entrance import check_record
from panoptic_ros.graph.nodes import FUSION, NODES
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.graph.topics import TOPICS, owner_of
from panoptic_ros.io.messages import bag_messages, from_message, to_message

EACH = 200  # messages


def damaged_record(item, owner, context, rng):
    """What a node makes of a message of this record in which one to three fields are wrong."""
    message = copy.deepcopy(to_message(item, bag_messages()))
    for _ in range(rng.integers(1, 4)):
        damage(message, rng)
    record = from_message(message, type(item).__name__)
    check_record(record, owner, context.rig, context.skeleton)
    return record


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("name", [name for name in NAMES if name != "detection"])
def test_no_message_breaks_a_stage(name):
    case, rng = cases()[name], np.random.default_rng(2)
    items = [i for i in case.items if not isinstance(i, (EndOfStream, ViewFrame, DepthFrame))]
    refused, taken = [], 0
    pipeline = Pipeline(
        configure({case.name: case.values}),
        case.context,
        [case.name],
        on_refused=lambda stage, error: refused.append(error),
    )
    for k in range(EACH):
        item = items[k % len(items)]
        kind = type(item).__name__
        topic = next(p.topic for p in NODES[case.name].inputs if TOPICS[p.topic].record == kind)
        try:
            record = damaged_record(item, owner_of(topic, item), case.context, rng)
        except DataError as error:
            assert "\n" not in str(error)
            refused.append(error)
            continue
        pipeline.push(topic, record)
        taken += 1
    assert taken and refused


def skeletons(items, live):
    """What the graph makes of 2D people: sets by stamp, and how many people they hold."""
    found = {}
    configs = configure({**VALUES, **({"sync": {"deadline_s": 0.5}} if live else {})})
    pipeline = Pipeline(
        configs,
        captures.CONTEXT,
        ("sync", *FUSION),
        on_refused=lambda stage, error: None,
        on_record=lambda topic, record: (
            found.update({record.stamp_ns: record.ids.tolist()}) if topic == "skeletons" else None
        ),
    )
    for item in items:
        pipeline.push("detections", item)
    return found


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("live", [False, True])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_damaged_messages_of_one_camera_cost_the_others_at_most_a_set(live, seed):
    rng, items, added = np.random.default_rng(seed), views(60, hidden=()), []
    cameras = len(captures.RIG.cameras)
    for k, item in enumerate(items):
        first = items[k // cameras * cameras]
        if 20 <= k < 120:
            for _ in range(rng.integers(4)):
                try:
                    added.append(damaged_record(first, first.camera, captures.CONTEXT, rng))
                except DataError:
                    continue
        added.append(item)
    expected, found = skeletons(items, live), skeletons(added, live)
    assert len(added) > len(items) + 10
    assert len(expected.keys() - found.keys()) <= 1 and not found.keys() - expected.keys()
    assert all(found[stamp] == [0, 1] for stamp in found)
