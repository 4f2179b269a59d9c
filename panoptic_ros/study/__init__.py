"""Every study and bench of `panoptic study`: see `names.STUDIES`."""
