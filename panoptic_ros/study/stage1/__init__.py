"""Stage one, from 2D people or score maps to skeletons: time, memory and accuracy beside named baselines.

Every case runs in a fresh process of one thread. Data: simulated people with all faults of a detector, score
maps drawn round their 2D joints (Gaussians of 1.3 cells; a network of 512 x 288 for HD, 256 x 192 for the
VGA rigs), or a bag. Baselines: the dense voter; greedy grouping with linear triangulation and the identity
of the nearest; linear triangulation, aniposelib's and a robust one with identities given by the simulator.
Rigs differ with the number of views (corners of a room, ring, dome, studio panels), so growth in views is
that of typical rigs.
"""
