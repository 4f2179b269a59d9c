"""Viewer of `panoptic view`: connects a web page with a recording or the live graph."""
