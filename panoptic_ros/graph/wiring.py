"""Connections of selected stages of the table: among each other and to the outside."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property

from panoptic_ros.errors import ContractError
from panoptic_ros.graph.nodes import NODES, NodeSpec, Port

Table = Mapping[str, NodeSpec]


@dataclass(frozen=True)
class TopicReader:
    """Stage that takes a topic: its number among the stages, and the number of the port in its row."""

    stage: int
    port: int


class Wiring:
    """Connections of selected stages, which are numbered in the order of the table.

    Args:
        names: Names of the stages.
        everywhere: All stages of the graph, of which `names` may be a part. None: `names` are all.
        table: The rows.

    Raises:
        ContractError: if a stage is not in the table.
    """

    def __init__(
        self, names: Collection[str], everywhere: Collection[str] | None = None, table: Table = NODES
    ):
        around = names if everywhere is None else everywhere
        unknown = [name for name in (*names, *around) if name not in table]
        if unknown:
            raise ContractError(f"there is no stage {unknown[0]!r}; there are {', '.join(table)}")
        self.table = table
        order = list(table)
        self.specs = tuple(spec for spec in table.values() if spec.name in names)
        self.ranks = tuple(order.index(spec.name) + 1 for spec in self.specs)
        self._around = tuple(spec for spec in table.values() if spec.name in around or spec.name in names)

    @cached_property
    def readers(self) -> dict[str, tuple[TopicReader, ...]]:
        """Return the readers of each topic, in the order of the rows."""
        found: dict[str, list[TopicReader]] = {}
        for stage, spec in enumerate(self.specs):
            for place, port in enumerate(spec.inputs):
                found.setdefault(port.topic, []).append(TopicReader(stage, place))
        return {topic: tuple(readers) for topic, readers in found.items()}

    @cached_property
    def given(self) -> frozenset[str]:
        """Return the topics that these stages give."""
        return frozenset(topic for spec in self.specs for topic in spec.outputs)

    @cached_property
    def inputs(self) -> tuple[Port, ...]:
        """Return the ports for topics from outside, one per topic."""
        outside: dict[str, Port] = {}
        for spec in self.specs:
            for port in spec.inputs:
                if port.topic not in self.given:
                    outside.setdefault(port.topic, port)
        return tuple(outside.values())

    @cached_property
    def leaving(self) -> frozenset[str]:
        """Return the topics of these stages that other stages of the graph take."""
        others = [spec for spec in self._around if spec not in self.specs]
        return self.given & {port.topic for spec in others for port in spec.inputs}

    @cached_property
    def heads(self) -> frozenset[int]:
        """Return the heads: stages that get feedback from a later one of these stages."""
        return frozenset(
            reader.stage
            for readers in self.readers.values()
            for reader in readers
            if self.port(reader).feedback and self._is_given_below(reader)
        )

    @cached_property
    def above(self) -> tuple[frozenset[int], ...]:
        """Return for each stage the set of itself and the stages upstream of it, without feedback."""
        found: list[frozenset[int]] = []
        for stage, spec in enumerate(self.specs):
            topics = {port.topic for port in spec.inputs}
            givers = [k for k in range(stage) if topics & set(self.specs[k].outputs)]
            found.append(frozenset({stage}).union(*(found[k] for k in givers)))
        return tuple(found)

    def port(self, reader: TopicReader) -> Port:
        """Return the port of a reader."""
        return self.specs[reader.stage].inputs[reader.port]

    def is_beside(self, reader: TopicReader) -> bool:
        """Return whether a reader's records are companions of the records that its stage works on.

        This holds if its port is optional and the stage also has ports that are not.
        """
        inputs = self.specs[reader.stage].inputs
        return self.port(reader).optional and not all(port.optional for port in inputs)

    def comes_back(self, reader: TopicReader, giver: int | None) -> bool:
        """Return whether a record is feedback for a reader.

        Args:
            giver: Number of the stage that gave it. None: an outside source, whose records are taken on
                arrival.
        """
        return self.port(reader).feedback and giver is not None and giver > reader.stage

    def reached(self, topic: str) -> frozenset[int]:
        """Return the stages that a topic from outside reaches, without feedback."""
        takers = {reader.stage for reader in self.readers[topic]}
        return frozenset(stage for stage in range(len(self.specs)) if self.above[stage] & takers)

    def _is_given_below(self, reader: TopicReader) -> bool:
        return any(self.port(reader).topic in spec.outputs for spec in self.specs[reader.stage + 1 :])
