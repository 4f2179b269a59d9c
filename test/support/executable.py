"""The executable of a node, in a process of its own or one that `fork_server` forks; says `up` with ROS."""

import sys
from importlib import import_module

STAGES = ("sync", "refinement")  # whose modules are imported ahead


def load():
    """Import what all nodes need."""
    from panoptic_ros.graph.build import config_class, resolve
    from panoptic_ros.graph.nodes import NODES

    import_module("panoptic_ros.nodes.main")
    for name in STAGES:
        config_class(name), resolve(NODES[name].stage)


def begin(name, *arguments):
    """Run the executable, which ends the process."""
    import rclpy

    init = rclpy.init

    def say_when_up(*words, **options):
        init(*words, **options)
        print("up", flush=True)

    rclpy.init = say_when_up
    sys.argv = [name, *arguments]
    getattr(import_module("panoptic_ros.nodes.main"), name)()


if __name__ == "__main__":
    begin(*sys.argv[1:])
