"""Studies and benchmarks of `panoptic study`; see `names.STUDIES`."""
