"""The only place with rclpy: thin nodes round the stages, sources, the recorder and the launcher."""
