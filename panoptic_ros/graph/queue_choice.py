"""How what comes to a node waits for its stages."""

from __future__ import annotations

from collections.abc import Callable, Collection

from panoptic_ros.graph.flow import BUSY, PATIENT, Flow
from panoptic_ros.graph.queues import InOrder, InstantsAndOthers, NewestInstant, Waiting
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.graph.wiring import Wiring


def queue_for(
    wiring: Wiring,
    flow: Flow,
    present: Collection[tuple[str, str]],
    full: Callable[[], bool] = lambda: False,
) -> Waiting:
    """Live: images wait as instants; a few of everything else, more samples of IMUs, or all where every
    message counts.

    Args:
        present: (topic, owner) of what comes. full: whether no other instant shall begin yet.
    """
    if flow.queue_limit is None:
        return InOrder()
    kinds = {
        topic: {wiring.specs[reader.stage].queue for reader in readers}
        for topic, readers in wiring.readers.items()
    }
    limits = {
        topic: PATIENT if kind == {"all"} else BUSY if kind == {"late"} else flow.queue_limit
        for topic, kind in kinds.items()
    }
    frequent = [f"{topic} {owner}" for topic, owner in present if TOPICS[topic].scope == "imu"]
    others = InOrder(lambda key: limits[key.split(" ")[0]], frequent)
    beside = {port.topic for port in wiring.inputs if port.patience_ns}
    instants = [
        f"{topic} {owner}" for topic, owner in present if "instant" in kinds[topic] and topic not in beside
    ]
    return InstantsAndOthers(NewestInstant(instants), instants, others, full) if instants else others
