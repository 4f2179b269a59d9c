"""Tree of coordinate frames, as TF publishes it."""

from __future__ import annotations

from collections.abc import Mapping

from panoptic_ros.errors import CalibrationError
from panoptic_ros.geometry.rigid import Rigid


class FrameTree:
    """Tree of frames. `transforms` maps a child to (parent, parent_from_child)."""

    def __init__(self, transforms: Mapping[str, tuple[str, Rigid]]):
        self._transforms = dict(transforms)

    @property
    def names(self) -> frozenset[str]:
        """Return all frames that occur as parent or child."""
        return frozenset(self._transforms) | {parent for parent, _ in self._transforms.values()}

    def root(self, frame: str) -> str:
        """Return the root of the tree that contains `frame`.

        Raises:
            CalibrationError: if the frames form a cycle.
        """
        return self._path(frame)[-1][0]

    def fixed_from(self, fixed: str, frame: str) -> Rigid:
        """Return the transform from `frame` to the frame `fixed` of the same tree.

        Raises:
            CalibrationError: if they are not in the same tree.
        """
        up, across = self._path(frame), dict(self._path(fixed))
        for name, transform in up:
            if name in across:
                return across[name].inverse().compose(transform)
        raise CalibrationError(
            f"TF does not connect {frame!r} with {fixed!r}: {frame!r} hangs on {up[-1][0]!r}, {fixed!r} on "
            f"{self.root(fixed)!r}"
        )

    def _path(self, frame: str) -> list[tuple[str, Rigid]]:
        """Return the frame and its ancestors, each with the transform from `frame` to it.

        Raises:
            CalibrationError: if the frames form a cycle.
        """
        path = [(frame, Rigid.identity())]
        while path[-1][0] in self._transforms:
            parent, transform = self._transforms[path[-1][0]]
            if any(parent == name for name, _ in path):
                raise CalibrationError(f"TF goes in a circle: {parent!r} hangs on itself")
            path.append((parent, transform.compose(path[-1][1])))
        return path
