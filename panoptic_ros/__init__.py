"""Online multi-view, multi-person 3D pose as a ROS 2 node graph.

The folder tree is the architecture: see docs/architecture.md. Nothing is imported here, so that
`import panoptic_ros` costs nothing and needs neither ROS nor a model.
"""

__version__ = "0.1.0"
