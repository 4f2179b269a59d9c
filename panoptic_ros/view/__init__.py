"""Drawings and tables for human readers.

They are overlays, mosaics, videos, 3D plots, the run report, the live table and progress bars. Inputs are
records of the graph and images. Outputs are pictures and videos in files, and text for a terminal. OpenCV
draws pictures; matplotlib draws plots without a display. No module opens a window. The nodes publish the
data for RViz and Foxglove.
"""
