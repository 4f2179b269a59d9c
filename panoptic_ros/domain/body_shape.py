"""Body thickness for drawings: tapered capsules on the segments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from panoptic_ros.domain.segments import SegmentModel
from panoptic_ros.errors import DataError, one_line

Array = np.ndarray


class Capsule(NamedTuple):
    """Tapered capsule in the frame of a segment.

    Args:
        segment: Index of the segment.
        begin, end: (3,) m, centres of the end spheres.
        radii: m, radii of the end spheres.
        wide: Ratio of the width along y to the width across.
    """

    segment: int
    begin: Array
    end: Array
    radii: tuple[float, float]
    wide: float


@dataclass(frozen=True, eq=False)
class BodyShape:
    """Capsules of a generic person, lengths as shares of the stature.

    Args:
        model: Model of the segments.
        rows: (segment, from, to, radii, wide). An end is a point (3,), or the index of a segment below.
    """

    model: SegmentModel
    rows: tuple[tuple[int, Array | int, Array | int, tuple[float, float], float], ...]

    def capsules(self, offsets: Array) -> list[Capsule]:
        """Return the capsules of a person.

        Args:
            offsets: (S, 3) m, joints in the frames of their parents.
        """
        tall = stature_of(self.model, offsets)

        def place(end: Array | int) -> Array:
            found: Array = offsets[end] if isinstance(end, int) else tall * end
            return found

        return [
            Capsule(segment, place(begin), place(end), (tall * radii[0], tall * radii[1]), wide)
            for segment, begin, end, radii, wide in self.rows
        ]


def stature_of(model: SegmentModel, offsets: Array) -> float:
    """Return the stature, m, for joints (S, 3) m in the frames of their parents."""
    lengths, shares = (np.linalg.norm(rows[1:], axis=-1).sum() for rows in (offsets, model.shares))
    return float(lengths / shares)


def offsets_of(model: SegmentModel, places: Array, frames: Array) -> Array:
    """Return the joints (S, 3) m in the frames of their parents; 0 for the root.

    They are medians over instants.

    Args:
        places: (N, S, 3) m, joint positions.
        frames: (N, S, 3, 3) orientations of the segments.
    """
    arms = (places - places[:, model.parents])[..., None]
    found: Array = np.median((frames[:, model.parents].swapaxes(-1, -2) @ arms)[..., 0], axis=0)
    found[0] = 0.0
    return found


def read_shape(document: Mapping[str, Any], model: SegmentModel) -> BodyShape:
    """Return the shape from a YAML document, see `config/bodies/shape21.yaml`.

    Capsules of segments that the skeleton lacks are left out.

    Raises:
        DataError: naming the segment and the error.
    """
    rows = []
    for name, capsules in document.items():
        if name not in model.names:
            continue
        segment = model.index(str(name))
        for row in capsules:
            if any(isinstance(row.get(key), str) and row[key] not in model.names for key in ("from", "to")):
                continue
            try:
                ends = [_end(row.get(key, (0, 0, 0)), model) for key in ("from", "to")]
                first, last = (float(radius) for radius in row["radii"])
                rows.append((segment, ends[0], ends[1], (first, last), float(row.get("wide", 1.0))))
            except (KeyError, TypeError, ValueError) as error:
                raise DataError(f"segment {name}: a capsule that cannot be read: {one_line(error)}") from None
    return BodyShape(model, tuple(rows))


def _end(value: Any, model: SegmentModel) -> Array | int:
    if isinstance(value, str):
        return model.index(value)
    x, y, z = (float(number) for number in value)
    return np.array([x, y, z])
