"""Read public data sets of human motion in their original files, and convert them to our records.

The readers follow the published papers and public descriptions of the formats. They are tested on generated
files, because the data themselves were not available.
"""
