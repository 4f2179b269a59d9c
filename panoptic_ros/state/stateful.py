"""Stages that hand over their state."""

from __future__ import annotations

from typing import ClassVar

from panoptic_ros.state import envelope
from panoptic_ros.state.layout import StateLayout
from panoptic_ros.state.reading import Reader
from panoptic_ros.state.writing import Writer


class Stateful:
    """Gives a class with a `LAYOUT` the methods `state` and `begin`."""

    LAYOUT: ClassVar[StateLayout]

    def reset(self) -> None:
        """Forget everything, as if just constructed."""
        raise NotImplementedError

    def forget(self) -> None:
        """Forget what was measured, and keep what the layout calls lasting, such as ids that are taken."""
        kept = {name: getattr(self, name) for name in self.LAYOUT.lasting}
        self.reset()
        for name, value in kept.items():
            setattr(self, name, value)

    def state(self) -> bytes:
        """All that later steps depend on; the stage is unchanged."""
        layout = self.LAYOUT
        writer = Writer(layout, layout.shared_objects(self))
        tree = writer.node(layout.values(self))
        return envelope.closed(layout, layout.conditions(self), tree, writer.arrays)

    def begin(self, state: bytes) -> None:
        """Replace all of the stage's own state by what `state` gave.

        Raises:
            DataError: if the bytes are not whole, or of another kind of stage, version, configuration or
                context; the stage is then unchanged.
        """
        layout = self.LAYOUT
        tree, data = envelope.opened(layout, layout.conditions(self), state)
        layout.set_values(self, Reader(layout, layout.shared_objects(self), data).values(tree))
