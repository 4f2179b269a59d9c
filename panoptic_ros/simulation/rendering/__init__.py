"""Rendered images of simulated people that pose networks can detect, with depth and person ids per pixel.

A person consists of some forty round cones (two spheres and the cone that touches both). They are squashed
where a body is flat, with clothes, face and hair painted on (`figure`, `wardrobe`, `paint`). A room with
textured walls surrounds the people (`room`), and they cast soft shadows on its floor. Each pixel's ray is
intersected with the cones in their own frames, and the nearest hit wins (`renderer`). Distorted lenses are
exact, because rays come from the camera model. Blur and sensor noise are added last. The same take gives the
same pictures.

Input: a `Simulation`. Output: `RenderedView`s. Limits: no furniture, no shadows on people, and skin and cloth
do not move over the bones. The joints lie inside the limbs, so detectors are off by some 2 px.
"""

from panoptic_ros.simulation.rendering.renderer import CameraRenderer, RenderedView, Studio

__all__ = ["CameraRenderer", "RenderedView", "Studio"]
