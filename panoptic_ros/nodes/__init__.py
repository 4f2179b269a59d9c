"""ROS 2 nodes: thin rclpy adapters around the stages, the sources, the recorder and the launcher.

Only this package imports rclpy.
"""
