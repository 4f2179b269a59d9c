"""The study `calibration-people`: cameras from people who walk, simulated and recorded."""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from panoptic_ros.calibration.projection import OFFSET, POSE
from panoptic_ros.calibration.quality import space_of
from panoptic_ros.domain import Rig
from panoptic_ros.errors import CalibrationError, UsageError
from panoptic_ros.geometry import Rigid
from panoptic_ros.geometry.rotations import vectors_of
from panoptic_ros.io.plain_formats import write_skeletons
from panoptic_ros.running.calibration.calibrate_people import PeopleCalibration, calibrate_views, read_views
from panoptic_ros.running.continuous import DETECTION_FILES
from panoptic_ros.running.evaluate import evaluate
from panoptic_ros.running.solve import solve, task_of
from panoptic_ros.simulation.degradation import MILD
from panoptic_ros.simulation.people_sessions import PeopleScene, PeopleSession, simulate_people
from panoptic_ros.simulation.rigs import Corners, Ring
from panoptic_ros.simulation.skeleton import SKELETON
from panoptic_ros.stage import Progress
from panoptic_ros.study.calibration.alignment import Similarity, similarity, triangulated
from panoptic_ros.study.calibration.peers import OWN, add_peers, attempts_from_people
from panoptic_ros.study.options import add_cases, add_seeds, known_names
from panoptic_ros.study.study import Case, Column, Result, Row, Study

Array = np.ndarray
SPACE = (np.linspace(-1.6, 1.6, 7), np.linspace(-1.6, 1.6, 7), np.linspace(0.1, 1.7, 5))  # m, space of people
LAG_S = 0.017  # s, half a frame of 30 Hz
FOUR, FIVE, EIGHT = Corners(4), Ring(5), Ring(8)
CASES = {
    "4": PeopleScene(FOUR),
    "5": PeopleScene(FIVE),
    "8": PeopleScene(EIGHT),
    "5-mild": PeopleScene(FIVE, degradation=MILD),
    "5-one": PeopleScene(FIVE, ("walk",)),
    "5-bias": PeopleScene(FIVE, degradation=MILD, bias_m=0.015),
    "4-lag": PeopleScene(FOUR, lag_s=LAG_S),
    "5-lag": PeopleScene(FIVE, lag_s=LAG_S),
    "5-lag-unsolved": PeopleScene(FIVE, lag_s=LAG_S),
}
ANNOTATION = "groundtruth3d.json.gz"  # file of 3D joints in a capture folder
UNSOLVED = "unsolved"  # ending of cases in which clocks are not estimated


class CalibrationPeople(Study):
    """Errors of cameras from people, beside predicted ones."""

    columns = (
        Column("case", "case"),
        Column("program", "program"),
        Column("failed", "failed", ".0%"),
        Column("rotation_rad", "rotation deg", ".3f", 180.0 / np.pi),
        Column("position_m", "position mm", ".2f", 1e3),
        Column("error_m", "error mm", ".2f", 1e3),
        Column("worst_m", "95 % mm", ".2f", 1e3),
        Column("predicted_m", "predicted mm", ".2f", 1e3),
        Column("nees", "NEES / dof", ".2f"),
        Column("joints", "joints", ".3f"),
        Column("up_rad", "up deg", ".2f", 180.0 / np.pi),
        Column("scale", "scale", ".1%"),
        Column("offset_s", "offset ms", ".2f", 1e3),
        Column("pcp", "PCP", ".2f"),
        Column("given_pcp", "PCP given", ".2f"),
        Column("solve_s", "solve s", ".1f"),
    )
    over = ("case", "program")

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        add_cases(parser, CASES)
        parser.add_argument(
            "--capture",
            type=Path,
            metavar="FOLDER",
            help="calibrate this capture instead, and compare with its own calibration",
        )
        parser.add_argument("--seconds", type=float, help="duration of the recordings; default 5")
        add_seeds(parser, "0:5")
        add_peers(parser)

    def cases(self) -> list[Case]:
        """See `Study`."""
        if self.options.capture:
            if self.options.peers:
                raise UsageError("libraries need the true association of people; omit --peers or --capture")
            return [Case(str(self.options.capture), None, 60.0)]
        return [
            Case(f"{name}, seed {seed}", (name, seed), CASES[name].seconds * len(CASES[name].activities))
            for name in known_names(self.options.cases, CASES, "case")
            for seed in self.options.seeds
        ]

    def measure(self, case: Case, progress: Progress) -> Iterator[Row]:
        """See `Study`."""
        if case.request is None:
            yield self._recorded(progress)
            return
        name, seed = case.request
        scene = CASES[name]
        if self.options.seconds:
            scene = replace(scene, seconds=self.options.seconds)
        session = simulate_people(scene, seed)
        row: Row = {"case": name, "seed": seed, "failed": 1.0}
        begin = time.perf_counter()
        try:
            found = calibrate_views(
                session.rig, session.views, SKELETON, progress, synchronous=name.endswith(UNSOLVED)
            )
        except CalibrationError:
            yield {**row, "program": OWN}
        else:
            row |= {"program": OWN, "failed": 0.0, "solve_s": time.perf_counter() - begin}
            yield {**row, **_own_errors(found, session.rig, _grid()), **_session_errors(found, session)}
        python = self.options.peers
        for peer in attempts_from_people(session.rig, session.joints, python) if python else ():
            row = {"case": name, "seed": seed, "program": peer.program, "failed": float(peer.rig is None)}
            if peer.rig is not None:
                errors = camera_errors(peer.rig, session.rig, _grid())
                row |= {"solve_s": peer.solve_s, **errors, "joints": _joint_ratio(peer.rig, session)}
            yield row

    def _recorded(self, progress: Progress) -> Row:
        known, views, skeleton, _ = read_views(self.options.capture, None, progress)
        begin = time.perf_counter()
        found = calibrate_views(known, views, skeleton, progress)
        spent = time.perf_counter() - begin
        aligned = _centres_aligned(found.rig, known)
        first = found.rig.cameras[0].cam_from_world.inverse()
        points = aligned.apply(first.apply(space_of(found.solved.rig)))
        placed = aligned_rig(found.rig, _aligned(found.rig, known, points)[0])
        return {
            **_limbs(self.options.capture, {"pcp": placed, "given_pcp": known}),
            "case": self.options.capture.name,
            "program": OWN,
            "failed": 0.0,
            "solve_s": spent,
            **_own_errors(found, known, points),
            "offset_s": float(np.ptp(found.solved.rig.state.cameras.offsets)),
        }

    def head(self, result: Result) -> str:
        """See `Study`."""
        return (
            "Cameras (number in the case) from 2 people who walk for 5 s, noisy detector, 30 Hz, lenses "
            "known.\nError: root mean square, in the space of people, of points triangulated from exact "
            "pixels, after similarity.\nJoints: error of triangulated joints over that with the true "
            "cameras. Lag: clocks off by up to 17 ms.\nBias: constant errors of 15 mm per joint, person, "
            "camera and axis. Other libraries (--peers) receive the true association, as they find none."
        )


def aligned_rig(rig: Rig, aligned: Similarity) -> Rig:
    """Return the rig after a similarity of its world."""
    cameras = []
    for camera in rig.cameras:
        turn = camera.cam_from_world.rotation @ aligned.rotation.T
        centre = aligned.apply(camera.centre[None])[0]
        cameras.append(replace(camera, cam_from_world=Rigid(turn, -turn @ centre), covariance=None))
    return Rig(tuple(cameras))


def _limbs(capture: Path, rigs: Mapping[str, Rig]) -> Row:
    """Return the PCP (percent, rule of VoxelPose) with each rig of an annotated capture."""
    found = [capture / name for name in DETECTION_FILES if (capture / name).is_file()]
    if not found or not (capture / ANNOTATION).is_file():
        return {}
    row: Row = {}
    with tempfile.TemporaryDirectory() as folder:
        for key, rig in rigs.items():
            task = task_of(rig, found[0], {})
            write_skeletons(Path(folder) / key, task.joint_names, solve(task).poses)
            scores = evaluate(capture / ANNOTATION, Path(folder) / key, protocol="pcp-voxelpose")
            row[key] = scores.values["pcp"]
    return row


def _grid() -> Array:
    return np.stack(np.meshgrid(*SPACE, indexing="ij"), -1).reshape(-1, 3)


def _centres_aligned(found: Rig, truth: Rig) -> Similarity:
    """Return the similarity that moves the found cameras to the true ones."""
    return similarity(
        np.stack([camera.centre for camera in found.cameras]),
        np.stack([camera.centre for camera in truth.cameras]),
    )


def _aligned(found: Rig, truth: Rig, points: Array) -> tuple[Similarity, Array]:
    """Return the similarity from found to true cameras at points (N, 3) m, and the errors, m, that remain."""
    pixels = []
    for camera in truth.cameras:
        own, seen = camera.project(points)
        pixels.append(np.where((seen & camera.contains(own))[:, None], own, np.nan))
    placed = triangulated(found, np.stack(pixels, axis=1))
    good = np.isfinite(placed).all(axis=1)
    aligned = similarity(placed[good], points[good])
    errors = np.linalg.norm(aligned.apply(placed[good]) - points[good], axis=1)
    return aligned, errors


def _own_errors(found: PeopleCalibration, truth: Rig, points: Array) -> Row:
    """Return the errors of `camera_errors`, the predicted one, and that of the up direction."""
    aligned, _ = _aligned(found.rig, truth, points)
    up = aligned.rotation[:, 2]
    return {
        **camera_errors(found.rig, truth, points),
        "predicted_m": found.quality.rig.error_m,
        "up_rad": float(np.arccos(np.clip(up[2], -1.0, 1.0))),
        "scale": abs(1.0 / aligned.factor - 1.0),
    }


def camera_errors(found: Rig, truth: Rig, points: Array) -> Row:
    """Return the errors of cameras after a similarity.

    Args:
        points: (N, 3) m in the frame of the truth, of the space in which people walk.
    """
    aligned, errors = _aligned(found, truth, points)
    turns = [
        t.cam_from_world.rotation @ aligned.rotation @ f.cam_from_world.rotation.T
        for f, t in zip(found.cameras, truth.cameras)
    ]
    centres = aligned.apply(np.stack([camera.centre for camera in found.cameras]))
    apart = np.linalg.norm(centres - np.stack([camera.centre for camera in truth.cameras]), axis=1)
    angles = np.linalg.norm(vectors_of(np.ascontiguousarray(np.stack(turns))), axis=1)
    return {
        "rotation_rad": float(np.median(angles)),
        "position_m": float(np.median(apart)),
        "error_m": float(np.sqrt((errors**2).mean())),
        "worst_m": float(np.percentile(errors, 95.0)),
    }


def _session_errors(found: PeopleCalibration, session: PeopleSession) -> Row:
    """Return the errors of covariance, clocks and joints of a simulated session."""
    rig = found.solved.rig
    states, truth = rig.state.cameras, session.rig
    reference = truth.cameras[0].cam_from_world.inverse()
    true = [camera.cam_from_world.compose(reference) for camera in truth.cameras]
    translations = np.stack([pose.translation for pose in true])
    held = np.argwhere(rig.index[1:, 3:POSE] < 0)[0] + [1, 0]
    factor = states.translations[tuple(held)] / translations[tuple(held)]
    turns = np.stack([t.rotation @ r.T for t, r in zip(true, states.rotations)])
    apart = np.concatenate(
        [vectors_of(np.ascontiguousarray(turns)), factor * translations - states.translations], axis=1
    )
    nees = []
    for c in range(1, len(truth)):
        own = rig.index[c, :POSE] >= 0
        rows = rig.index[c, :POSE][own]
        miss, covariance = apart[c, own], rig.covariance[np.ix_(rows, rows)]
        nees.append(miss @ np.linalg.solve(covariance, miss) / len(miss))
    late = (states.offsets - states.offsets[0]) - (session.offsets - session.offsets[0])
    free = rig.index[:, OFFSET] >= 0
    return {
        "nees": float(np.mean(nees)),
        "offset_s": float(np.sqrt((late[free] ** 2).mean())) if free.any() else np.nan,
        "joints": _joint_ratio(found.rig, session),
    }


def _joint_ratio(found: Rig, session: PeopleSession) -> float:
    """Return the median error of joints in three views or more over that with the true cameras."""
    seen = session.joints
    keys, row = np.unique(np.stack([seen.frame, seen.person, seen.joint]), axis=1, return_inverse=True)
    pixels = np.full((keys.shape[1], len(found), 2), np.nan)
    pixels[row.reshape(-1), seen.camera] = seen.pixels
    use = np.isfinite(pixels).all(axis=2).sum(axis=1) >= 3
    frame, person, joint = keys[:, use]
    truth = np.stack([one.joints(session.times) for one in session.people])[person, frame, joint]
    exact = triangulated(session.rig, pixels[use], plain=False)
    own = triangulated(found, pixels[use], plain=False)
    good = np.isfinite(own).all(axis=1) & np.isfinite(exact).all(axis=1)
    own = similarity(own[good], exact[good]).apply(own)
    ours, theirs = (np.nanmedian(np.linalg.norm(points - truth, axis=1)) for points in (own, exact))
    return float(ours / theirs)
