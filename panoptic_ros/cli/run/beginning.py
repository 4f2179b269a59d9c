"""Start a child process and the discovery of other graphs before a run is planned.

Loading and discovery take seconds, so they run in parallel with the planning.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager

from panoptic_ros.running.processes.children import LaunchPreparation
from panoptic_ros.running.processes.shared_memory import prepare_shared_memory


@contextmanager
def begun(args: argparse.Namespace) -> Iterator[LaunchPreparation]:
    """Yield a child process that loads the nodes, and a listener for other graphs.

    Neither is started if the whole run stays in this process.
    """
    over_dds = not (args.in_process or args.offline)
    if over_dds:
        prepare_shared_memory()  # before the import of ROS, which terminates if shared memory is full
    with LaunchPreparation(over_dds) as ahead:
        if over_dds:
            from panoptic_ros.running.runs.listening import begin_to_listen  # needs ROS

            begin_to_listen(ahead, args.namespace)
        yield ahead
