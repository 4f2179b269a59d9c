"""What is begun before a run is planned, as loading and listening take seconds."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager

from panoptic_ros.running.processes.children import Ahead
from panoptic_ros.running.processes.shared_memory import prepare_shared_memory


@contextmanager
def begun(args: argparse.Namespace) -> Iterator[Ahead]:
    """A process that loads, and ears for other graphs, unless all is to run in this process."""
    over_dds = not (args.in_process or args.offline)
    if over_dds:
        prepare_shared_memory()  # before ROS is loaded, which a full one ends
    with Ahead(over_dds) as ahead:
        if over_dds:
            from panoptic_ros.running.runs.listening import begin_to_listen  # needs ROS

            begin_to_listen(ahead, args.namespace)
        yield ahead
