"""Identity of people over time, shared by association and tracking.

`motion` holds one constant-velocity filter per joint. It predicts people, so that association finds them
again in the images of the next instant and tracking finds them among the skeletons. `assignment` pairs
people. `likeness` and `appearance` score whether a new track is a lost track, from bone lengths, position and
clothes. `bone_lengths` learns bone lengths, and `subjects` finds designated people.
"""
