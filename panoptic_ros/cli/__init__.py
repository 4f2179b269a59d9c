"""The program `panoptic`: one module per verb with `add_arguments(parser)` and `run(args) -> int`."""
