"""Hold the estimated clocks of named cameras, and test if clocks deviate from their lines (`straying`)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from panoptic_ros.domain import ClockModel, DetectionSet
from panoptic_ros.offsets.estimate import ClockFit
from panoptic_ros.offsets.uncertainty import covariance_of, detector_bias, inflation
from panoptic_ros.solving.clock_gauge import KNOWN, acquainted, common_shift

Array = np.ndarray
SURE = 3.0  # standard deviations beyond which a known offset is significant
SECOND = 1_000_000_000
PART = 1.0  # s, length of the parts that are compared with the whole
LEAST = 3e-3  # s; smaller deviations are ignored
CHANCE = 6.0  # standard deviations by which a part may deviate by chance


@dataclass(frozen=True, slots=True, eq=False)
class CameraClocks:
    """Clocks of C cameras: corrected = timestamp + offset + drift * (timestamp - reference).

    Args:
        cameras: (C,) names.
        reference_ns: (ns) reference time.
        offsets: (C,) s, at the reference.
        drifts: (C,) dimensionless.
        covariance: (2C, 2C) of (offsets, drifts).
        known: (C,) True if the camera observed enough motion to know its offset relative to the other known
            ones.
        bias: (m) estimated systematic error of the 2D joints; part of the standard deviations.
        speed: (C,) m/s, rms speed of the joints across the camera's rays.
        rays: (C,) number of 2D joints used.
        iterations, converged: statistics of the estimate.
        held: (C,) True if the camera was corrected before. It then stays corrected.
        strays: (C,) s, see `straying`; part of the standard deviations.
    """

    cameras: tuple[str, ...]
    reference_ns: int
    offsets: Array
    drifts: Array
    covariance: Array
    known: Array
    bias: float
    speed: Array
    rays: Array
    iterations: int
    converged: bool
    held: Array
    strays: Array

    @classmethod
    def unknown(cls, cameras: Iterable[str], reference_ns: int) -> CameraClocks:
        """Return clocks without any information."""
        names = tuple(cameras)
        zero = np.zeros(len(names))
        return cls(
            names,
            reference_ns,
            zero,
            zero,
            np.diag(np.repeat([0.1**2, 1e-4**2], len(names))),
            np.zeros(len(names), bool),
            0.0,
            zero,
            np.zeros(len(names), np.int64),
            0,
            True,
            np.zeros(len(names), bool),
            zero,
        )

    @classmethod
    def of(
        cls, fit: ClockFit, cameras: Iterable[str], reference_ns: int, prior: Array, trusted: str = ""
    ) -> CameraClocks:
        """Return the clocks of a fit.

        Args:
            trusted: camera whose timestamps are right; "": see `uncertainty.common_shift`.
        """
        state = np.concatenate([fit.offsets, fit.drifts])
        clocks = cls.stated(cameras, reference_ns, state, covariance_of(fit, prior), trusted, fit)
        return replace(clocks, strays=straying(fit, clocks.bias, inflation(fit)))

    @classmethod
    def stated(
        cls,
        cameras: Iterable[str],
        reference_ns: int,
        state: Array,
        covariance: Array,
        trusted: str,
        fit: ClockFit,
        held: Array | None = None,
    ) -> CameraClocks:
        """Return the clocks of a state (2C,) and its covariance about the mean.

        They are relative to the trusted camera, if there is one.

        Args:
            fit: newest fit, for its statistics.
            held: (C,) cameras that are already corrected.
        """
        names = tuple(cameras)
        count = len(names)
        offsets, drifts = state[:count].copy(), state[count:].copy()
        base = np.arange(count) == names.index(trusted) if trusted else acquainted(covariance[:count, :count])
        gauge = np.kron(np.eye(2), np.eye(count) - base / base.sum())
        covariance = gauge @ covariance @ gauge.T
        deviations = np.sqrt(np.maximum(np.diag(covariance)[:count], 0.0))
        known = deviations <= KNOWN
        if trusted:
            offsets, drifts = offsets - offsets[base], drifts - drifts[base]
        elif known.any():
            offsets -= common_shift(offsets[known], deviations[known])
            drifts -= drifts[known].mean()
        known &= known.sum() > 1  # a single camera has no reference camera
        speed = np.array(
            [np.sqrt(_mean((fit.across[fit.seen.camera == c] ** 2).sum(axis=1))) for c in range(count)]
        )
        rays = np.bincount(fit.seen.camera, minlength=count)
        return cls(
            names,
            reference_ns,
            offsets,
            drifts,
            covariance,
            known,
            detector_bias(fit),
            speed,
            rays,
            fit.iterations,
            fit.converged,
            np.zeros(count, bool) if held is None else held,
            np.zeros(count),
        )

    def after(self, before: CameraClocks, trusted: str) -> CameraClocks:
        """Return these clocks as successors of the clocks `before`, without steps of corrected time.

        The clocks are shifted so that most of the corrected cameras do not step, unless a camera is trusted.
        A camera that is no longer known keeps its old clock.
        """
        since = 1e-9 * (self.reference_ns - before.reference_ns)
        old = before.offsets + before.drifts * since
        both, lost = self.held & self.known, self.held & ~self.known
        shift = float(np.median((self.offsets - old)[both])) if both.any() and not trusted else 0.0
        return replace(
            self,
            offsets=np.where(lost, old, self.offsets - shift),
            drifts=np.where(lost, before.drifts, self.drifts),
        )

    def then(self, later: CameraClocks) -> CameraClocks:
        """Compose these clocks with clocks estimated from timestamps corrected by these clocks.

        If the later clocks know a camera, they determine its uncertainty. Otherwise these clocks do.
        """
        span = 1e-9 * (self.reference_ns - later.reference_ns)
        use, after = self.applied, later.applied
        offsets, drifts = np.where(use, self.offsets, 0.0), np.where(use, self.drifts, 0.0)
        more = later.offsets + later.drifts * (span + offsets)
        both = np.concatenate([later.known, later.known])
        covariance = np.where(both[:, None] & both, later.covariance, self.covariance)
        covariance = np.where(both[:, None] == both, covariance, 0.0)
        return replace(
            later,
            reference_ns=self.reference_ns,
            covariance=covariance,
            known=self.known | later.known,
            offsets=offsets + np.where(after, more, 0.0),
            held=use | after,
            drifts=drifts + np.where(after, later.drifts * (1.0 + drifts), 0.0),
        )

    @property
    def deviations(self) -> Array:
        """Return the standard deviations (C,) s of the offsets."""
        variances = np.maximum(np.diag(self.covariance)[: len(self.cameras)], 0.0)
        deviations: Array = np.sqrt(variances + self.strays**2)
        return deviations

    def stated_at(self, stamps_ns: Array) -> tuple[Array, Array]:
        """Return the offsets (C, ...) s at camera timestamps (C, ...) ns, with standard deviations.

        If camera clocks show very different times, the reference is far from most recordings. The offset at
        the reference is then uncertain too.
        """
        count, axes = len(self.cameras), (-1,) + (1,) * (stamps_ns.ndim - 1)
        since = 1e-9 * (stamps_ns - self.reference_ns)
        blocks = self.covariance.reshape(2, count, 2, count)
        own = np.einsum("pcqc->pqc", blocks).reshape(2, 2, *(count, *axes[1:]))
        variance = own[0, 0] + 2.0 * own[0, 1] * since + own[1, 1] * since**2
        offsets = self.offsets.reshape(axes) + self.drifts.reshape(axes) * since
        return offsets, np.sqrt(np.maximum(variance, 0.0) + self.strays.reshape(axes) ** 2)

    @property
    def drift_deviations(self) -> Array:
        """Return the standard deviations (C,) of the drifts."""
        return np.sqrt(np.maximum(np.diag(self.covariance)[len(self.cameras) :], 0.0))

    @property
    def applied(self) -> Array:
        """Return a mask (C,) of corrected cameras: corrected before, or with a significant offset now."""
        used: Array = self.held | self.known & (np.abs(self.offsets) > SURE * self.deviations)
        return used

    def corrections(self, sets: Iterable[DetectionSet], every: bool = False) -> dict[str, Array]:
        """Return the correction (K,) ns of each frame timestamp by camera, in the order of the sets.

        Args:
            every: True to correct also cameras whose offset is not `applied`.
        """
        table: dict[str, list[float]] = {name: [] for name in self.cameras}
        use = np.ones(len(self.cameras), bool) if every else self.applied
        for item in sets:
            for view in item.views:
                c = self.cameras.index(view.camera)
                since = view.stamp_ns - self.reference_ns
                shift = 1e9 * self.offsets[c] + self.drifts[c] * since
                table[view.camera].append(shift if use[c] else 0.0)
        return {name: np.array(values) for name, values in table.items()}

    def models(self) -> list[ClockModel]:
        """Return the corrections as clock models, one per camera; 0 for cameras not `applied`."""
        count, models = len(self.cameras), []
        for c, name in enumerate(self.cameras):
            pick = np.ix_([c, count + c], [c, count + c])
            use = self.applied[c]
            models.append(
                ClockModel(
                    name,
                    self.reference_ns,
                    0,
                    self.drifts[c] if use else 0.0,
                    self.covariance[pick],
                    residual_ns=1e9 * self.offsets[c] if use else 0.0,
                )
            )
        return models


def _mean(values: Array) -> float:
    return float(values.mean()) if len(values) else 0.0


def straying(fit: ClockFit, bias: float, inflation: float) -> Array:
    """Return the maximum deviation (C,) s of each clock from its line over the parts of the time; 0 if none.

    The rays of a camera in one part measure its clock there, given everything else. Deviations that chance or
    a bias of the detected joints explains are ignored.

    Args:
        bias: (m) bias of the 2D joints, see `uncertainty.detector_bias`.
        inflation: factor of the variances.
    """
    seen, cameras = fit.seen, len(fit.offsets)
    worst = np.zeros(cameras)
    if not len(seen.stamp):
        return worst
    parts = np.floor((seen.stamp - seen.stamp.min()) / PART).astype(np.int64)
    count = int(parts.max()) + 1
    cell, cells = seen.camera * count + parts, cameras * count
    strength = np.bincount(cell, fit.precision * (fit.across**2).sum(axis=1), cells)
    pull = np.bincount(cell, fit.precision * (fit.across * fit.misses).sum(axis=1), cells)
    weight = np.bincount(cell, fit.precision, cells)
    told = strength > 0.0
    shift, variance = np.zeros(cells), np.full(cells, np.inf)
    shift[told] = -pull[told] / strength[told]
    variance[told] = inflation / strength[told] + bias**2 * weight[told] / strength[told]
    far = (np.abs(shift) > LEAST) & (shift**2 > CHANCE**2 * variance)
    np.maximum.at(worst, np.arange(cells) // count, np.where(far, np.abs(shift), 0.0))
    return worst
