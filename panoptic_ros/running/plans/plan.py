"""Defines the plan of a run: cameras, sources of their data, skeleton, parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from panoptic_ros.capture import DepthSensorSource
from panoptic_ros.domain import Rig, SkeletonModel
from panoptic_ros.errors import CalibrationError
from panoptic_ros.graph.nodes import CHAIN, SOUND
from panoptic_ros.io.bag_streams import IMU_KEY, SOUND_KEY, BagStream
from panoptic_ros.params import Config

BODIES = "kinematics"  # the stage that needs no camera
VIEWS = ("detection", "sync")  # the stages that single views pass


@dataclass(frozen=True)
class Plan:
    """Complete description of a run, before anything has started.

    Args:
        title: Name of the source in the report.
        sources: Description of the source of each camera for `nodes.sources`; empty for bags and running
            drivers.
        streams: Topics of bags: one per camera, plus those of depth maps, 2D tracks, sound and IMUs.
        sounds: Descriptions of devices that record the cameras' clocks, for `capture.sound.open_sound`.
        heard: Live: devices whose sound other nodes publish.
        shifts: By camera, and for sound by topic: ns added to timestamps. They bring all timestamps roughly
            to master time, and place sound ahead of the frames.
        topics: Topics of running drivers, by key of `graph.topics.TOPICS` and camera.
        encodings: By camera: encoding of raw images whose driver states another one.
        depth_cameras: Cameras whose images come with depth maps.
        maps: Depth maps of separate depth sensors in a capture folder.
        stage: First stage of the run, detection or sync.
        views_only: Whether no stage runs after sync.
        extras: Additional input of detection and assembly; empty if there is none.
        frame_count: Total number of frames of all cameras; None if unknown.
        instants: Number of frames of the longest camera; None if unknown.
        frame_rate: Hz.
        live: Whether the sources are devices rather than recordings.
        namespace: Namespace of the graph's nodes and topics.
        publish: Output formats of `nodes.listeners.people_node` for other packages.
        subjects: Files of the designated people.
        imus: File of samples by device; empty for bags and running drivers.
        worn: Devices on the designated people, in the order of their files.
        until_ns: End of a recording: records with this or a later timestamp are left out; None = no limit.
        notices: Lines about adaptations of the input.
    """

    title: str
    rig: Rig
    skeleton: SkeletonModel
    configs: Mapping[str, Config]
    sources: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    streams: tuple[BagStream, ...] = ()
    sounds: tuple[Mapping[str, Any], ...] = ()
    heard: tuple[str, ...] = ()
    shifts: Mapping[str, int] = field(default_factory=dict)
    topics: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    encodings: Mapping[str, str] = field(default_factory=dict)
    depth_cameras: tuple[str, ...] = ()
    maps: tuple[DepthSensorSource, ...] = ()
    stage: str = "detection"
    views_only: bool = False
    extras: Mapping[str, Any] = field(default_factory=dict)
    frame_count: int | None = None
    instants: int | None = None
    frame_rate: float = 30.0
    live: bool = False
    namespace: str = ""
    publish: tuple[str, ...] = ()
    subjects: tuple[Path, ...] = ()
    imus: Mapping[str, Path] = field(default_factory=dict)
    worn: tuple[str, ...] = ()
    until_ns: int | None = None
    notices: tuple[str, ...] = ()

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Return the names of the result's joints, in their order."""
        return self.skeleton.joint_names

    @property
    def stages(self) -> tuple[str, ...]:
        """Return all stages from the first one on. Parameters may switch some of them off.

        Without cameras, the kinematics stage runs alone.
        """
        if not self.rig.cameras:
            return (BODIES,)
        sound = SOUND if self.devices else ()
        later = CHAIN[CHAIN.index(self.stage) :]
        return (*sound, *(name for name in later if name in VIEWS or not self.views_only))

    @property
    def devices(self) -> tuple[str, ...]:
        """Return the devices whose sound is used."""
        recorded = (stream.camera for stream in self.streams if stream.key == SOUND_KEY)
        return (*(str(sound["device"]) for sound in self.sounds), *recorded, *self.heard)

    @property
    def imu_devices(self) -> tuple[str, ...]:
        """Return the IMUs whose samples arrive, from a file or from bags; in a live run, all worn IMUs."""
        recorded = tuple(stream.camera for stream in self.streams if stream.key == IMU_KEY)
        return self.worn if self.live else (*self.imus, *recorded)

    def at(self, owner: str, stamp_ns: int) -> int:
        """Return the approximate master time, ns, of a timestamp.

        Args:
            owner: camera, or topic of the sound.
        """
        return stamp_ns + self.shifts.get(owner, 0)

    def clock_of(self, owner: str) -> str:
        """Return the clock that timestamps the records of a camera or device; "" = the common clock."""
        return self.rig.clock_of(owner)


def require_cameras(rig: Rig, designated: bool = False) -> None:
    """Check for enough cameras: two, or one if subjects are given, as one camera is enough for their bodies.

    Raises:
        CalibrationError: if there are too few.
    """
    if len(rig) < (1 if designated else 2):
        raise CalibrationError(
            f"{len(rig)} camera ({', '.join(rig.names)}) is not enough for 3D; add cameras, or "
            "--subject FILE for the body of a designated person, for which one is enough"
        )
