"""Two people of the default skeleton who swing their limbs on circles, before free-running cameras."""

import captures
import cv2
import numpy as np
from free_cameras import START_NS, FreeCapture

from panoptic_ros.continuous.elhayek.body_blobs import body_blobs
from panoptic_ros.continuous.elhayek.skeleton import skeleton_of
from panoptic_ros.domain import ViewFrame
from panoptic_ros.io.body_models import read_body_model, read_body_shape

MODEL = read_body_model()
NAMES = captures.SKELETON.joint_names
BODIES = (MODEL.body(1.62), MODEL.body(1.83))
SKELETONS = tuple(skeleton_of(body, NAMES) for body in BODIES)
LEFT, RIGHT = 12, 20  # first degree of freedom of a side: shoulder (3), elbow, hip (3), knee


def freedoms(times, person=0):
    """Degrees of freedom (T, D) at times (T,) s: a walk on a circle, 1.3 strides a second."""
    phase = 2.0 * np.pi * 1.3 * np.asarray(times)
    angle = (1.0 if person else -1.0) * np.asarray(times) + 2.0 * person
    radius = (0.6, 1.5)[person]
    found = np.zeros((len(phase), SKELETONS[person].freedoms))
    found[:, 0], found[:, 1] = radius * np.cos(angle), radius * np.sin(angle)
    found[:, 2] = 0.95 + 0.02 * np.cos(2.0 * phase)
    found[:, 3] = angle + (0.5 if person else -0.5) * np.pi
    found[:, 7] = 0.1 + 0.05 * np.cos(phase)
    for first, sign in ((LEFT, 1.0), (RIGHT, -1.0)):
        swing = sign * np.sin(phase)
        found[:, first] = 0.5 * swing
        found[:, first + 1] = 0.7
        found[:, first + 3] = -sign * (0.6 + 0.3 * swing)
        found[:, first + 4] = -0.5 * swing
        found[:, first + 7] = 0.5 + 0.4 * np.cos(phase + sign)
    return found


class HingedCapture(FreeCapture):
    """`FreeCapture` of these people."""

    def joints(self, time_s):
        return np.concatenate([s.joints(freedoms([time_s], p)) for p, s in enumerate(SKELETONS)])


def painted(capture):
    """Yield images of all views, camera by camera: discs of the body's blobs before a grey wall."""
    shape = read_body_shape(MODEL)
    bodies = [body_blobs(skeleton, shape) for skeleton in SKELETONS]
    for number, camera in enumerate(capture.rig.cameras):
        own = [view for item in capture.sets for view in item.views if view.camera == camera.name]
        for k, view in enumerate(own):
            image = np.full((*camera.image_size[::-1], 3), 110 + number, np.uint8)
            time, discs = 1e-9 * (view.stamp_ns - START_NS), []
            for person, (skeleton, body) in enumerate(zip(SKELETONS, bodies)):
                (points,) = skeleton.place(freedoms([time], person)).points(body.segments, body.offsets)
                depths = camera.cam_from_world.apply(points)[:, 2]
                for segment, depth, pixel, radius in zip(
                    body.segments, depths, camera.project(points)[0], body.radii
                ):
                    hue = (40 * int(segment) + 90 * person) % 180
                    discs.append((depth, pixel, 800.0 * radius / depth, (hue, 220, 200 - 60 * person)))
            for _, pixel, radius, colour in sorted(discs, key=lambda disc: -disc[0]):
                bgr = cv2.cvtColor(np.array([[colour]], np.uint8), cv2.COLOR_HSV2BGR)[0, 0].tolist()
                cv2.circle(image, np.rint(pixel).astype(int).tolist(), max(1, round(radius)), bgr, -1)
            yield ViewFrame(camera.name, view.stamp_ns, k, image)
