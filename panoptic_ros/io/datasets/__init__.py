"""Public data sets of moving people in the files that they come in, to our records.

Written from the published papers and from public descriptions of the formats, and tested on files that the
tests write: the data themselves were not at hand.
"""
