"""Motion of the surface of people: points followed in images, rigid parts and patches in 3D.

`flow` runs beside detection, where the images are: it follows a pattern of points on every 2D person from
image to image and gives 2D tracks alone. `PatchesStage` puts the tracks of the views of an instant on the
people who are tracked, finds how every rigid part moved, with covariance (`rigid`), and keeps patches of
their surface with identity. Joo et al. 2017, section 6; deviations are told in docs/patches.md.
"""
