"""Solving of joints from several views, shared by association, voting, assembly and offsets.

`scene` holds one instant: its 2D poses, flattened, ordered and undistorted once, the cameras and their
visibility limits. `agreement` measures how well 2D poses agree. `triangulation` and `joints` compute
positions by triangulation and by Gauss-Newton on the reprojection error, with Cauchy weights and gates.
`bodies` estimates whole bodies from few views. `limbs` finds limbs with exchanged sides.
"""
