"""Motion of a simulated body: a T-pose, then recorded motion with added twists about the bones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from panoptic_ros.geometry.chain import place_all
from panoptic_ros.geometry.rotations import (
    from_quaternions,
    rotations_of,
    to_quaternions,
    turn_about_z,
    vectors_of,
)
from panoptic_ros.geometry.segment_chain import Chain

Array = np.ndarray
CLIP_HZ = 30.0
# s; duration of the T-pose, and of the blend from it, or between two clips, into the next clip
T_POSE_S, BLEND_S = 2.0, 1.0
TWISTS = {  # segment: (axis of the bone, standard deviation of the added twist in degrees)
    "lForearm": (1, 26.0),
    "rForearm": (1, 26.0),
    "head": (2, 14.0),
    "lHand": (1, 8.0),
    "rHand": (1, 8.0),
}
TWIST_HZ = (0.1, 0.6)


@dataclass(frozen=True, eq=False)
class Clip:
    """Recorded motion of one body at 30 Hz.

    Args:
        roots: Root positions (T, 3) m.
        vectors: Rotation vectors (T, S, 3).
        offsets: Segment offsets (S, 3) m.
        stature: Body height, m.
    """

    roots: Array
    vectors: Array
    offsets: Array
    stature: float


@dataclass(frozen=True, eq=False)
class BodyMotion:
    """Motion of a body at T times.

    Args:
        times: Times (T,) s.
        roots: Root positions (T, 3) m.
        turns: Rotations (T, S, 3, 3) of the segments relative to their parents.
        places: Segment origins (T, S, 3) m, world.
        frames: Segment rotations (T, S, 3, 3), world from segment.
    """

    times: Array
    roots: Array
    turns: Array
    places: Array
    frames: Array


def clips_of(arrays: Mapping[str, Array]) -> dict[str, Clip]:
    """Return the clips by name, from the arrays of `config/bodies/cmu-motion.npz`."""
    return {
        str(name): Clip(
            arrays[f"root_{name}"].astype(float),
            arrays[f"vectors_{name}"].astype(float),
            arrays[f"offsets_{name}"].astype(float),
            float(arrays[f"stature_{name}"]),
        )
        for name in arrays["clips"]
    }


def laid_out(clips: Sequence[Clip], path: Sequence[float]) -> list[Clip]:
    """Return the clips centred at the same place, or chained along a path.

    In a chain, each clip is rotated to its direction and starts where the previous one ended.

    Args:
        path: Direction (deg) of each clip, or empty.
    """
    if not path:
        return [replace(clip, roots=clip.roots - np.append(clip.roots[:, :2].mean(0), 0.0)) for clip in clips]
    found, begin = [], np.zeros(2)
    for clip, degrees in zip(clips, path):
        turn, vectors = turn_about_z(np.radians(degrees)), clip.vectors.copy()
        vectors[:, 0] = vectors_of(np.ascontiguousarray(turn @ rotations_of(clip.vectors[:, 0])))
        roots = clip.roots @ turn.T
        roots[:, :2] += begin - roots[0, :2]
        begin = roots[-1, :2].copy()
        found.append(replace(clip, roots=roots, vectors=vectors))
    return found


def moved(motion: BodyMotion, angle: float, at: Sequence[float]) -> BodyMotion:
    """Return the motion rotated about the vertical by `angle` rad and shifted by `at` (2,) m."""
    turn, shift = turn_about_z(angle), np.append(at, 0.0)
    turns = motion.turns.copy()
    turns[:, 0] = turn @ turns[:, 0]
    return BodyMotion(
        motion.times,
        motion.roots @ turn.T + shift,
        turns,
        motion.places @ turn.T + shift,
        turn @ motion.frames,
    )


def make_motion(
    rng: np.random.Generator,
    names: Sequence[str],
    clips: Sequence[Clip],
    rate: float,
    t_pose_deg: float,
    chain: Chain,
) -> BodyMotion:
    """Return a motion: a T-pose facing +x, then the clips one after another.

    Args:
        rate: Rate of the result, Hz.
        t_pose_deg: Error of the T-pose per joint and axis, deg (standard deviation).
    """
    quaternions, roots = [], []
    for clip in clips:
        turns = rotations_of(clip.vectors.reshape(-1, 3)).reshape(*clip.vectors.shape, 3)
        quaternions.append(to_quaternions(turns))
        roots.append(clip.roots)
    off = np.radians(t_pose_deg) * rng.normal(size=(len(names), 3))
    stand = rotations_of(off)
    first = roots[0][0].copy()
    first[2] = _standing_height(chain, stand)
    held = int(T_POSE_S * CLIP_HZ)
    all_q = [np.tile(to_quaternions(stand), (held, 1, 1))]
    all_r = [np.tile(first, (held, 1))]
    for q, r in zip(quaternions, roots):
        all_q.append(_bridge_quaternions(all_q[-1][-1], q[0]))
        all_r.append(_bridge(all_r[-1][-1], r[0]))
        all_q.append(q)
        all_r.append(r)
    joined, places = _continuous(np.concatenate(all_q)), np.concatenate(all_r)
    seconds = np.arange(len(places)) / CLIP_HZ
    times = np.arange(int(seconds[-1] * rate)) / rate
    turned = from_quaternions(CubicSpline(seconds, joined)(times))
    fade = np.clip((times - T_POSE_S) / BLEND_S, 0.0, 1.0)[:, None]
    for name, (axis, degrees) in TWISTS.items():
        if name in names:
            vector = np.zeros((len(times), 3))
            vector[:, axis] = np.radians(degrees) * _wander(rng, times)
            s = list(names).index(name)
            turned[:, s] = turned[:, s] @ rotations_of(fade * vector)
    root = CubicSpline(seconds, places)(times)
    placed, frames = place_all(chain, root, turned)
    return BodyMotion(times, root, turned, placed, frames)


def _standing_height(chain: Chain, turns: Array) -> float:
    """Return the height (m) of the root at which the lowest joint is at its usual 4 cm."""
    places, _ = place_all(chain, np.zeros((1, 3)), turns[None])
    return 0.04 - float(places[0, :, 2].min())


def _wander(rng: np.random.Generator, times: Array) -> Array:
    """Return smooth random numbers (T,) of variance 1."""
    speed = 2 * np.pi * rng.uniform(*TWIST_HZ, 6)
    found: Array = np.sin(times[:, None] * speed + rng.uniform(0, 2 * np.pi, 6)).sum(1) / np.sqrt(3.0)
    return found


def _bridge(begin: Array, end: Array) -> Array:
    share = _smooth_step()[:, None]
    found: Array = begin * (1 - share) + end * share
    return found


def _bridge_quaternions(begin: Array, end: Array) -> Array:
    """Return rotations (N, S, 4) along the shortest arcs from one posture to another."""
    a, b = from_quaternions(begin), from_quaternions(end)
    vectors = vectors_of(np.ascontiguousarray(a.swapaxes(1, 2) @ b))
    steps = [a @ rotations_of(share * vectors) for share in _smooth_step()]
    return to_quaternions(np.array(steps))


def _smooth_step() -> Array:
    x = np.arange(1, int(BLEND_S * CLIP_HZ)) / (BLEND_S * CLIP_HZ)
    found: Array = x * x * (3 - 2 * x)
    return found


def _continuous(quaternions: Array) -> Array:
    """Return the quaternions (T, S, 4) with signs that do not jump."""
    flips = (quaternions[1:] * quaternions[:-1]).sum(-1) < 0
    signs = np.concatenate([np.ones((1, flips.shape[1])), np.cumprod(np.where(flips, -1.0, 1.0), axis=0)])
    found: Array = quaternions * signs[..., None]
    return found
