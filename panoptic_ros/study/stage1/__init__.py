"""Study of stage one (2D poses or score maps to skeletons): time, memory and accuracy next to baselines.

Every case runs in a fresh process with one thread. The data are simulated persons with all errors of a
detector, or a bag. Score maps are drawn around the 2D joints: Gaussians of 1.3 cells, for a network of 512 x
288 (HD rigs) or 256 x 192 (VGA rigs).

Baselines are the dense voter, and greedy grouping with linear triangulation and nearest-neighbour identity.
Further baselines triangulate with identities from the simulator: linear, aniposelib's and a robust one.

The rig type depends on the number of views (corners of a room, ring, dome, studio panels). The growth of time
with views is therefore that of typical rigs.
"""
