"""Serialises the state of a stage to bytes. Another stage of the same kind can begin from these bytes.

A `StateLayout` defines which attributes of a stage are its state. `Stateful` uses it to give a stage the
methods `state` and `begin`. The bytes contain values and named fields, never code: classes come from the
layout alone. A head identifies stage, layout, configuration and context, and contains a checksum. So bytes of
another stage, and cut or damaged bytes, are rejected.

Everything is restored exactly: floats to the last bit, the memory order of arrays, which arrays are
read-only, and which mutable objects are shared. Equal states give equal bytes, whether or not their stage
began from bytes.
"""

from panoptic_ros.state.layout import Fields, StateLayout
from panoptic_ros.state.stateful import Stateful

__all__ = ["Fields", "StateLayout", "Stateful"]
