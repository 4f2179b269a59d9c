"""Images of simulated people that pose networks detect, with depth and person ids per pixel.

A person is some forty round cones (two spheres and the cone that touches both), squashed where a
body is flat, with clothes, face and hair painted on (`figure`, `wardrobe`, `paint`). A room with
textured walls stands round them (`room`), they throw soft shadows on its floor (`shadows`). Each pixel's
ray is intersected with the cones in their own frames and the nearest hit wins (`raycast`); lenses
with distortion are exact, because rays come from the camera model. Blur and noise of a sensor come
last (`renderer`). The same take gives the same pictures.

In: a `Simulation`. Out: `RenderedView`s. Limits: no furniture, no shadows on people, skin and cloth do
not move over the bones; the joints lie inside of the limbs, so detectors are off by some 2 px.
"""

from panoptic_ros.simulation.rendering.renderer import CameraRenderer, RenderedView, Studio

__all__ = ["CameraRenderer", "RenderedView", "Studio"]
