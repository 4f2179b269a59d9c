"""What `panoptic view` joins: a page, and a recording or the live graph."""
