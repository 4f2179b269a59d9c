"""The exact search: local maxima of eq. 1, found coarse to fine without visiting empty space."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from panoptic_ros.voting import box_kernels, limit_kernels, voxel_kernels
from panoptic_ros.voting.lanes import GAUSSIAN_END
from panoptic_ros.voting.lens_bounds import BINS, seen_radius, slope_bounds
from panoptic_ros.voting.peak_kernels import highest
from panoptic_ros.voting.proposals import Demands, Nodes
from panoptic_ros.voting.pyramid_kernels import GROUP, Pyramids, build_pyramids, clear_pyramids
from panoptic_ros.voting.scene import LENS_FIELDS, VoteScene, lens_of, map_sizes
from panoptic_ros.voting.volume import Volume

Array = np.ndarray
PAD = 6  # cells after each row: rows 4 KB apart would all need the same places in the cache
BOUNDS = np.dtype(
    [*((name, np.float64) for name in ("across", "bend_end", "far_x", "far_y")),
     ("bends", np.float64, (BINS, 2))]
)  # fmt: skip


class BoxScene(NamedTuple):
    """What the kernels of the search need of V views and of up to 32 joints.

    cameras, limits: as in `VoteScene`; map_start, map_data: the same for these joints.
    bounds: (V,) records `BOUNDS`: across, the sum of |R2k|; bend_end, the end of the lens bounds (0 without
        distortion); far_x and far_y, the largest |x| and |y| of the image in the plane at 1 m (with
        distortion the radius that is seen, twice); bends, the lens bounds.
    pyramids: see there.
    people: (V, J, P, 4) pixel, 1 / (2 width^2), score; NaN where missing.
    reach: (V, P, 4) least and largest u, least and largest w that a person's keypoints reach.
    pointed: (V,) mask of the joints that have keypoints instead of maps.
    limit_layers (V, L, 3), limit_reach (N, 2): see `limit_kernels`.
    supporting: smallest value of a map that supports.
    """

    cameras: Array
    limits: Array
    bounds: Array
    pyramids: Pyramids
    people: Array
    reach: Array
    pointed: Array
    map_start: Array
    map_data: Array
    limit_layers: Array
    limit_reach: Array
    supporting: int


class BoxSearch:
    """Finds all local maxima; holds the lens bounds of the cameras it has met, and memory."""

    def __init__(self) -> None:
        self._lenses: dict[bytes, tuple[Array, float, float]] = {}
        self._memory = new_pyramids(0)

    def nodes(self, scene: VoteScene, volume: Volume, wanted: Demands) -> Nodes:
        """Nodes at the centres of all local maxima, in the order of joint and voxel.

        These are voxels that satisfy the demands, and none of whose 26 neighbours that do has more votes (nor
        equally many and comes before it).
        """
        bounds, count = self._bounds(scene), len(scene.cameras)
        every = np.column_stack([np.arange(count), np.full(count, -1)]).astype(np.int32)
        found = [(np.zeros((0, 6), np.int64), np.zeros(0))]
        for first in range(0, scene.map_start.shape[1], GROUP):
            boxes = box_scene(scene, bounds, first, wanted.view_threshold, self._pyramids(scene))
            joints = (1 << boxes.map_start.shape[1]) - 1
            small = box_kernels.Boxes(np.array([[0, 0, 0, joints, 0]]), np.array([0, count]), every)
            for level in range(max(max(volume.shape) - 1, 1).bit_length() - 1, 0, -1):
                small = box_kernels.split(boxes, small, level, volume, wanted)
            rows, votes = voxel_kernels.visit(boxes, small, volume, wanted)
            found.append((rows + [first, 0, 0, 0, 0, 0], votes))
        rows, votes = (np.concatenate(parts) for parts in zip(*found))
        joints, x, y, z, support, likely = np.ascontiguousarray(rows.T)
        voxels = np.stack([x, y, z], axis=-1)
        top = np.flatnonzero(highest(joints, voxels - volume.lower + 1, votes, likely))
        order = top[np.lexsort([z[top], y[top], x[top], joints[top]])]
        return Nodes(volume.centres(voxels), joints, votes, support).rows(order)

    def _pyramids(self, scene: VoteScene) -> Pyramids:
        """Empty pyramids, large enough for the maps."""
        layers, cells = pyramid_layers(map_sizes(scene.cameras))
        if cells >= len(self._memory[1]):
            self._memory = new_pyramids(cells)
        clear_pyramids(*self._memory)
        return Pyramids(layers, *self._memory)

    def _bounds(self, scene: VoteScene) -> Array:
        bounds = np.zeros(len(scene.cameras), BOUNDS)
        for view, mine in zip(scene.cameras, bounds):
            mine["across"] = abs(view["r20"]) + abs(view["r21"]) + abs(view["r22"])
            y = (np.array([-0.5, view["height"] - 0.5]) - view["cy"]) / view["fy"]
            x = (np.array([[-0.5], [view["width"] - 0.5]]) - view["cx"] - view["skew"] * y) / view["fx"]
            lens, terms = lens_of(view)
            if lens == "brown" and not terms.any():
                mine["far_x"], mine["far_y"] = np.abs(x).max() * 1.000001, np.abs(y).max() * 1.000001
                continue
            key = view[LENS_FIELDS].tobytes()
            if key not in self._lenses:
                fold, reach = float(np.sqrt(view["fold"])), float(np.hypot(x, y).max())
                seen = seen_radius(lens, terms, fold, reach)
                self._lenses[key] = (*slope_bounds(lens, terms, seen), seen)
            mine["bends"], mine["bend_end"], mine["far_x"] = self._lenses[key]
            mine["far_y"] = mine["far_x"]
        return bounds


def box_scene(
    scene: VoteScene, bounds: Array, first: int, view_threshold: float, pyramids: Pyramids
) -> BoxScene:
    """The arrays of the joints first, first + 1, ..., at most 32; fills the empty pyramids."""
    supporting = max(int(np.ceil(255.0 * view_threshold - 1e-6)), 1)  # value of a cell
    build_pyramids(scene, pyramids, first, supporting)
    mine = slice(first, first + GROUP)
    people = scene.people[:, mine].copy()
    people[scene.map_start[:, mine] >= 0] = np.nan
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.sqrt(GAUSSIAN_END / people[..., 2])
    known = people[..., 3] > 0.0
    people[~known] = np.nan
    u, w = people[..., 0], people[..., 1]
    boxes = np.stack([u - reach, -u - reach, w - reach, -w - reach], axis=-1)
    boxes = np.where(known[..., None], boxes, np.inf).min(axis=1, initial=np.inf) * (1.0, -1.0, 1.0, -1.0)
    pointed = (known.any(axis=2) * (1 << np.arange(people.shape[1]))).sum(axis=1)
    return BoxScene(
        scene.cameras, scene.limits, bounds, pyramids, people, np.ascontiguousarray(boxes), pointed,
        np.ascontiguousarray(scene.map_start[:, mine]), scene.map_data, *_limit_pyramids(scene), supporting,
    )  # fmt: skip


def _limit_pyramids(scene: VoteScene) -> tuple[Array, Array]:
    """Layers and pyramids of the limits; next to nothing where there are none."""
    count = len(scene.cameras)
    layers, cells = pyramid_layers(scene.limits[: 3 * count].reshape(-1, 3)[:, 1:].astype(np.int64))
    reach = np.empty((cells, 2))
    limit_kernels.build_limits(layers, reach, scene.limits)
    return layers, reach


def new_pyramids(cells: int) -> tuple[Array, Array]:
    """Empty `Pyramids.spread` and `masks`, and a cell more that is always empty.

    No row of the former lies across two lines of the cache.
    """
    cells += 1
    buffer = np.zeros(cells * GROUP + 63, np.uint8)
    skip = -buffer.ctypes.data % 64
    return buffer[skip : skip + cells * GROUP].reshape(cells, GROUP), np.zeros(cells, np.int64)


def pyramid_layers(grid: Array) -> tuple[Array, int]:
    """Layers (V, L, 3) of pyramids on maps of grid (V, 2) cells, up to a single cell, and all cells.

    Widths are those of the rows in memory, which end in empty cells.
    """
    most = max(int(grid.max(initial=1)) - 1, 0).bit_length() + 1
    size = grid.copy()
    layers = np.zeros((len(grid), most, 3), np.int64)
    for layer in range(most):
        layers[:, layer, 1:] = size
        layers[:, layer, 1] += np.where(size[:, 0] > PAD, PAD, 0)
        done = np.all(size <= 1, axis=1)
        size = np.where(done[:, None], 0, (size + 1) // 2)
    cells = layers[..., 1] * layers[..., 2]
    layers[..., 0] = (np.cumsum(cells) - cells.ravel()).reshape(cells.shape)
    return layers, int(cells.sum())
