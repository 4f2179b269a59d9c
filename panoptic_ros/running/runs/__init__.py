"""The course of a run, in one process or through ROS nodes, and its results."""
