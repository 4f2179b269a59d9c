"""Studies of the number and kind of cameras, after Joo et al. 2017, 7.3, on simulated people.

`cameras`: 2 to 7 people in the user's rig; 2D people of a simulated detector; the same people solved
from 480, 240, ... 10 cameras, each the farthest from those before it: PCK curves (Fig. 8), node and skeleton
accuracy (Table 3). `resolution`: rendered images of 19 HD cameras, of the 19 VGA cameras nearest to them,
and of these at half the width (QVGA), through the default detector.

The truth is exact, where the paper took the result of 480 cameras for it.
"""
