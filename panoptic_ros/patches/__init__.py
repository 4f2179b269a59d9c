"""Surface motion of people: points tracked in images, rigid parts and patches in 3D.

`flow` runs beside detection, in the process that has the images. It tracks a pattern of points on every 2D
pose from image to image, and outputs 2D tracks only. `PatchesStage` assigns the 2D tracks of an instant's
views to the tracked people. It estimates the motion of every rigid part, with covariance (`rigid`), and keeps
surface patches with identity. The method is Joo et al. 2017, section 6. docs/notes/patches.md lists the
deviations.
"""
