"""The same capture told differently: other orders, another world frame, other pixels, one more camera."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from panoptic_ros.domain import Camera, DetectionSet, Rig, ScoreMaps
from panoptic_ros.geometry import Rigid
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.pipeline import records_of
from panoptic_ros.simulation.studio import scaled
from panoptic_ros.stage import StageContext


def solve(rig, skeleton, sets, settings):
    """Pose sets of assembly, with what is fed back."""
    return records_of("poses", sets, configure(settings), StageContext(rig, skeleton))


def largest_gap(expected, found, back=lambda points: points):
    """Largest distance (m) between joints of the same people; infinite if people or joints differ."""
    worst = 0.0
    for a, b in zip(expected, found, strict=True):
        positions = back(b.positions)
        if len(a.positions) != len(positions):
            return np.inf
        free = list(range(len(positions)))
        for person in a.positions:
            gaps = [np.nanmean(np.linalg.norm(person - positions[k], axis=-1)) for k in free]
            other = positions[free.pop(int(np.argmin(gaps)))]
            if (np.isnan(person) != np.isnan(other)).any():
                return np.inf
            worst = max(worst, float(np.nanmax(np.abs(person - other))))
    return worst


def other_order_of_cameras(rig, sets, order):
    place = {rig.names[i]: k for k, i in enumerate(order)}
    turned = [replace(s, views=tuple(sorted(s.views, key=lambda v: place[v.camera]))) for s in sets]
    return Rig(tuple(rig.cameras[i] for i in order)), turned


def other_order_of_people(sets, rng):
    def view(v):
        order = rng.permutation(len(v.points))
        maps = v.maps
        if maps is not None:
            new_index = np.append(np.argsort(order), -1)
            maps = replace(maps, persons=new_index[maps.persons])
        return replace(
            v, points=v.points[order], scores=v.scores[order], person_scores=v.person_scores[order], maps=maps
        )

    return [replace(s, views=tuple(view(v) for v in s.views)) for s in sets]


def moved_world(rig, new_from_old: Rigid):
    old_from_new = new_from_old.inverse()
    return Rig(tuple(replace(c, cam_from_world=c.cam_from_world.compose(old_from_new)) for c in rig.cameras))


def scaled_images(rig, sets, factor):
    """Pixel centres are whole numbers, so the image grows about its top left corner, (-0.5, -0.5)."""
    shift = 0.5 * factor - 0.5
    cameras = Rig(tuple(scaled(camera, factor) for camera in rig.cameras))

    def view(v):
        maps = v.maps
        if maps is not None:
            affine = maps.grid_from_image.copy()
            affine[:, :2] /= factor
            affine[:, 2] -= affine[:, :2] @ [shift, shift]
            maps = replace(maps, grid_from_image=affine)
        size = cameras.camera(v.camera).image_size
        return replace(v, image_size=size, points=v.points * factor + shift, maps=maps)

    return cameras, [replace(s, views=tuple(view(v) for v in s.views)) for s in sets]


def with_blind_cameras(rig, sets, count):
    """Cameras far above that look up; their views are there, with nobody in them."""
    model = rig.cameras[0]
    up = Rigid(np.eye(3), np.array([0.0, 0.0, -9.0]))
    blind = [Camera(f"blind{k}", model.image_size, model.intrinsics, up) for k in range(count)]

    def extended(s: DetectionSet):
        like = s.views[0]
        maps = like.maps and ScoreMaps(
            like.maps.grid_size, like.maps.grid_from_image, (), (), np.zeros((0, 2)), np.zeros((0, 2)), ()
        )
        joints = like.points.shape[1]
        empty = [
            replace(
                like,
                camera=c.name,
                image_size=c.image_size,
                points=np.zeros((0, joints, 2)),
                scores=np.zeros((0, joints)),
                person_scores=np.zeros(0),
                maps=maps,
            )
            for c in blind
        ]
        return replace(s, views=(*s.views, *empty))

    return Rig((*rig.cameras, *blind)), [extended(s) for s in sets]
