"""Compiled kernels against numpy, and numpy against geometry."""

from __future__ import annotations

import numpy as np
import pytest

from panoptic_ros.simulation.rendering.paint import paint_pixels
from panoptic_ros.simulation.rendering.renderer import NOTHING, cast_rays
from panoptic_ros.simulation.rendering.shapes import Material, ShapeBuilder
from test.support.rendered_in_numpy import cast_rays_reference, paint_reference

WIDTH, HEIGHT = 80, 60
PLANE = np.stack(
    np.meshgrid(np.linspace(-0.8, 0.8, WIDTH), np.linspace(-0.6, 0.6, HEIGHT)), axis=-1
)  # of a camera at the origin that looks along z
MATERIALS = list(Material)


def random_shapes(seed, count=12):
    """Cones in front of the camera, some squashed, some with one sphere inside the other."""
    rng = np.random.default_rng(seed)
    build = ShapeBuilder(0, 1.0)
    for n in range(count):
        start = np.array([[*rng.uniform(-1.5, 1.5, 2), rng.uniform(2.5, 4.0)]])
        end = start + rng.normal(0.0, 0.5, (1, 3)) * (n % 4 > 0)
        axes, squash = None, (1.0, 1.0, 1.0)
        if n % 3 == 0:
            axes, squash = np.linalg.qr(rng.normal(size=(1, 3, 3)))[0], tuple(rng.uniform(0.6, 1.3, 3))
        radii = tuple(rng.uniform(0.05, 0.4, 2))
        build.add(start, end, radii, rng.uniform(0, 255, 3), MATERIALS[n % 5], axes, squash)
    return build.shapes()


def cast(shapes, kernel):
    """Depth and hits of shapes seen from the origin along z."""
    depth, hits = np.full((HEIGHT, WIDTH), 9.0, np.float32), np.full((HEIGHT, WIDTH), NOTHING, np.int16)
    frames = np.ascontiguousarray(shapes.local_from_world[0])
    origins = -(frames @ shapes.origins[0][..., None])[..., 0]
    boxes = np.tile([0, 0, WIDTH, HEIGHT], (len(frames), 1))
    kernel(frames, origins, shapes.lengths[0], shapes.radii, shapes.materials, boxes, PLANE, depth, hits)
    return depth, hits


def colour(shapes, depth, hits, kernel):
    image, ids = np.zeros((HEIGHT, WIDTH, 3), np.uint8), np.zeros((HEIGHT, WIDTH), np.uint8)
    kernel(
        np.ascontiguousarray(shapes.local_from_world[0]),
        shapes.origins[0],
        shapes.lengths[0],
        shapes.radii,
        shapes.materials,
        shapes.seeds,
        shapes.colours,
        shapes.people,
        np.zeros(3),
        np.eye(3),
        PLANE,
        depth,
        hits,
        image,
        ids,
    )
    return image, ids


@pytest.mark.parametrize("seed", range(4))
def test_compiled_kernels_equal_numpy(seed):
    shapes = random_shapes(seed)
    depth, hits = cast(shapes, cast_rays)
    wanted_depth, wanted_hits = cast(shapes, cast_rays_reference)
    assert (hits != NOTHING).mean() > 0.1 and len(np.unique(hits)) > 5
    same = hits == wanted_hits
    assert same.mean() > 0.999, "rounding may differ at an edge"
    assert depth[same] == pytest.approx(wanted_depth[same], abs=1e-5)
    image, ids = colour(shapes, depth, hits, paint_pixels)
    wanted, wanted_ids = colour(shapes, depth, hits, paint_reference)
    assert (ids == wanted_ids).all() and (ids == (hits != NOTHING)).all()
    close = np.abs(image.astype(int) - wanted).max(-1) <= 1
    assert close.mean() > 0.999, "a pixel at the edge of a stripe may fall on either side"


def one(start, end, radii, **more):
    build = ShapeBuilder(0, 1.0)
    build.add(np.array([start]), np.array([end]), radii, np.ones(3), **more)
    return build.shapes()


def test_a_sphere_is_where_it_is():
    depth, hits = cast(one([0.0, 0.0, 3.0], [0.0, 0.0, 3.0], (0.5, 0.5)), cast_rays_reference)
    t = depth[hits != NOTHING]
    points = PLANE[hits != NOTHING] * t[:, None]
    radius = np.sqrt((points**2).sum(1) + (t - 3.0) ** 2)
    assert radius == pytest.approx(np.full(len(t), 0.5), abs=1e-4)
    assert t.min() == pytest.approx(2.5, abs=2e-3)
    angle = np.degrees(np.arctan(np.linalg.norm(PLANE[hits != NOTHING], axis=1).max()))
    assert angle == pytest.approx(np.degrees(np.arcsin(0.5 / 3.0)), abs=1.0)


def test_every_hit_of_a_round_cone_is_on_its_surface():
    """The surface is the envelope of spheres along the axis with radii in between."""
    start, end, radii = np.array([-0.6, 0.1, 3.0]), np.array([0.7, -0.2, 2.6]), (0.35, 0.1)
    depth, hits = cast(one(start, end, radii), cast_rays_reference)
    there = hits != NOTHING
    points = np.column_stack([PLANE[there] * depth[there][:, None], depth[there]])
    share = np.linspace(0.0, 1.0, 2001)
    centres = start + share[:, None] * (end - start)
    sizes = radii[0] + share * (radii[1] - radii[0])
    gaps = np.linalg.norm(points[:, None] - centres[None], axis=-1) - sizes
    assert there.sum() > 200 and np.abs(gaps.min(axis=1)).max() < 1e-4


def test_an_ellipsoid_is_squashed_along_its_axes():
    shapes = one([0.0, 0.0, 3.0], [0.0, 0.0, 3.0], (0.5, 0.5), axes=np.eye(3)[None], squash=(1.0, 0.5, 0.2))
    depth, hits = cast(shapes, cast_rays_reference)
    rows, columns = np.nonzero(hits != NOTHING)
    assert depth.min() == pytest.approx(2.9, abs=2e-3)
    wide, high = np.ptp(PLANE[rows, columns], axis=0)
    assert wide / high == pytest.approx(2.0, rel=0.15)


def test_hair_leaves_the_face_open():
    axes = np.array([[[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]]).swapaxes(1, 2)
    towards = np.stack([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]], axis=-1)[None]  # looks at us
    for frame, open_face in ((towards, True), (axes, False)):
        shapes = one([0.0, 0.0, 3.0], [0.0, 0.0, 3.0], (0.5, 0.5), material=Material.HAIR, axes=frame)
        _, hits = cast(shapes, cast_rays_reference)
        assert (hits[HEIGHT // 2, WIDTH // 2] == NOTHING) == open_face
