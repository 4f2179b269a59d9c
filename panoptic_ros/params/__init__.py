"""Parameters as frozen dataclasses: one source for code, ROS, files, docs and the command line.

A stage's configuration is a subclass of `Config` whose fields are made with `param`. From it come
the ROS declarations (`nodes/`), `config/*.yaml`, `docs/parameters.md` and `--set stage.name=value`.
No files are opened here.
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
