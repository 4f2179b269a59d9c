"""Solving: joints from several views, for association, voting, assembly and offsets.

The scene of an instant (`scene`): its 2D people flattened, ordered and undistorted once, where the cameras
were, and how far they see. How well 2D people agree (`agreement`), and positions by triangulation and by
Gauss-Newton on the reprojection error, with Cauchy weights and gates.
"""
