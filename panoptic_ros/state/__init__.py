"""What a stage remembers, as bytes that another stage of the same kind can begin from.

A `StateLayout` names once which attributes of a stage are its state; `Stateful` gives a stage `state` and
`begin` from it. The bytes are values and named fields, never code: classes come from the layout alone. A
head says which stage, layout, configuration and context they are for, and has a checksum: foreign, cut or
damaged bytes are refused. Everything is restored to the last bit: floats, the order of arrays in memory,
which arrays are read-only, and which objects that can change several others refer to. Equal states are equal
bytes, whether or not their stage began from bytes.
"""

from panoptic_ros.state.layout import Fields, StateLayout
from panoptic_ros.state.stateful import Stateful

__all__ = ["Fields", "StateLayout", "Stateful"]
