"""Who is who over time: the motion of people who are followed, shared by association and tracking.

One constant-velocity filter per joint (`motion`) serves to predict people, so that association finds them
again in the images of the next instant and tracking finds them among the skeletons. `assignment` pairs
people, `likeness` recognises those who return, `subjects` finds those who are designated.
"""
