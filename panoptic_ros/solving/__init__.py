"""Solving: joints from several views, for association, voting, assembly and offsets.

The evidence of an instant (`evidence`): its 2D people flattened, ordered and undistorted once. What kernels
take of it and of the cameras (`scene`). How well 2D people agree (`agreement`), how far views see (`sight`),
and positions by triangulation and by Gauss-Newton on the reprojection error, with Cauchy weights and gates.
"""
