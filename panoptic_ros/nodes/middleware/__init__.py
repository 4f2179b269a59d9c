"""What rclpy gives to all nodes: executors, messages as bytes, QoS, subscriptions, parameters, threads."""
