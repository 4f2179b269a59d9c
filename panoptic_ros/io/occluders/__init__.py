"""Known occluders from files: what stands in the room between cameras and people.

`occluders.json` ("panoptic-occluders-1") holds boxes and triangles; meshes may also be PLY or Wavefront OBJ
files, on their own or named by an occluders.json beside them. All in metres, in the world of the rig.

Limits: PLY as text or little-endian binary, OBJ without curves; polygons become fans of triangles, so they
should be convex. Normals, colours and materials are ignored: surfaces hide from both sides.
"""

from panoptic_ros.io.occluders.document import FILE, read_occluders, write_occluders

__all__ = ["FILE", "read_occluders", "write_occluders"]
