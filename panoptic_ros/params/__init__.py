"""Defines parameters as frozen dataclasses: one source for code, ROS, files, docs and the command line.

The configuration of a stage is a subclass of `Config`, with fields made by `param`. The ROS declarations
(`nodes/`), `config/*.yaml`, `docs/parameters.md` and `--set stage.name=value` are derived from it. This
package opens no files.
"""

from panoptic_ros.params.config import (
    Config,
    Param,
    config_of,
    describe,
    diff,
    from_text,
    load,
    param,
    to_mapping,
)
from panoptic_ros.params.named import named_numbers, named_words, of_name

__all__ = [
    "Config",
    "Param",
    "config_of",
    "describe",
    "diff",
    "from_text",
    "load",
    "named_numbers",
    "named_words",
    "of_name",
    "param",
    "to_mapping",
]
