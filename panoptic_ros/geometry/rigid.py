"""Rigid transforms, named `b_from_a`: x_b = rotation @ x_a + translation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from panoptic_ros.errors import CalibrationError

Array = np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class Rigid:
    """Rotation and translation.

    Args:
        rotation: (3, 3) orthonormal to 1e-4, determinant +1; kept as given, not re-orthonormalised.
        translation: (3,) m.

    Raises:
        CalibrationError: if the rotation matrix is not a rotation, or shapes or values are invalid.
    """

    rotation: Array
    translation: Array

    def __post_init__(self) -> None:
        rotation = np.array(self.rotation, np.float64)
        translation = np.array(self.translation, np.float64).reshape(-1)
        if rotation.shape != (3, 3) or translation.shape != (3,):
            raise CalibrationError(
                f"a rigid transform needs a 3x3 rotation and 3 numbers of translation, found "
                f"{rotation.shape} and {translation.shape}"
            )
        if not (np.isfinite(rotation).all() and np.isfinite(translation).all()):
            raise CalibrationError("a rigid transform has numbers that are not finite")
        error, determinant = _faults(rotation)
        if error > 1e-4 or determinant < 0.0:
            kind = "mirrors (determinant -1)" if error <= 1e-4 else f"is off by {error:.2g}"
            raise CalibrationError(f"a rotation matrix {kind}; is it really the rotation?")
        rotation.flags.writeable = translation.flags.writeable = False
        object.__setattr__(self, "rotation", rotation)
        object.__setattr__(self, "translation", translation)

    @classmethod
    def identity(cls) -> Rigid:
        """Return the identity transform."""
        return cls(np.eye(3), np.zeros(3))

    def apply(self, points: Array) -> Array:
        """Transform points (..., 3) from frame a to frame b."""
        moved: Array = np.asarray(points) @ self.rotation.T + self.translation
        return moved

    def inverse(self) -> Rigid:
        """Return the inverse transform a_from_b."""
        return Rigid(self.rotation.T, -self.rotation.T @ self.translation)

    def compose(self, b_from_a: Rigid) -> Rigid:
        """Return c_from_a = c_from_b.compose(b_from_a)."""
        return Rigid(
            self.rotation @ b_from_a.rotation,
            self.rotation @ b_from_a.translation + self.translation,
        )


def _faults(rotation: Array) -> tuple[float, float]:
    """Return the greatest entry of |R R' - 1| of a matrix (3, 3), and its determinant.

    Numbers of Python take a tenth of the time of arrays, and overflow to infinity without a warning.
    """
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    error = max(
        abs(a * a + b * b + c * c - 1.0),
        abs(d * d + e * e + f * f - 1.0),
        abs(g * g + h * h + i * i - 1.0),
        abs(a * d + b * e + c * f),
        abs(a * g + b * h + c * i),
        abs(d * g + e * h + f * i),
    )
    return error, a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
