"""Wrappers around rclpy for all nodes: executor, raw messages, QoS, subscriptions, parameters, worker."""
