"""What a person sees: overlays, mosaics, videos, 3D plots, the report, the live table, progress.

In: records of the graph and images. Out: pictures and videos in files, text for a terminal. Pictures
are drawn with OpenCV, plots with matplotlib without a display. Limits: no window is ever
opened; viewers for RViz and Foxglove are fed by the nodes.
"""
