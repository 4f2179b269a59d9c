"""Which topics of a bag are replayed, so that the stages from one on do their work anew."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from panoptic_ros.errors import UsageError
from panoptic_ros.graph.nodes import NODES
from panoptic_ros.graph.topics import TOPICS, variants


def topics_from(begin: str) -> frozenset[str]:
    """Keys of the topics that the graph needs when it begins with a topic: it, what stages behind it take
    from elsewhere, and what is latched. Stages and ports that are off unless asked for do not count.

    Args:
        begin: key of a topic, e.g. detections, or the name of the stage that gives it.

    Raises:
        UsageError: if there is neither.
    """
    keys = set(NODES[begin].outputs) if begin in NODES else {begin}
    if begin not in NODES and begin not in TOPICS:
        raise UsageError(
            f"--from {begin}: there is no such topic or stage; topics are {', '.join(TOPICS)}, stages "
            f"{', '.join(NODES)}"
        )
    given, taken = set(keys), set[str]()
    for spec in NODES.values():  # in the order in which records go down
        ports = {port.topic for port in spec.inputs if not port.switch}
        if ports & given and not spec.switch:
            given |= set(spec.outputs)
            taken |= ports
    wanted = keys | (taken - given) | {key for key, topic in TOPICS.items() if topic.latched}
    return frozenset(wanted | {variant for key in wanted for variant in variants(key)})


def chosen_topics(topics: Mapping[str, str], keys: Collection[str]) -> list[str]:
    """The topics of a bag that carry these topics of the graph, in any namespace.

    Args:
        topics: of the bag, kind of message by name.
    """
    return [name for name, kind in topics.items() if key_of(name, kind) in keys]


def key_of(name: str, kind: str) -> str:
    """The key of the topic of the graph that a topic of a bag carries, in any namespace; "" = none."""
    rows = {key: row for key, row in TOPICS.items() if row.message == kind}
    endings = {key: "/" + row.name.split("{owner}/")[-1] for key, row in rows.items()}
    found = [key for key, ending in endings.items() if name.endswith(ending)]
    return max(found, key=lambda key: len(endings[key]), default="")
