"""What a run consists of: cameras, where their data come from, skeleton, parameters."""

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


@dataclass(frozen=True)
class Plan:
    """A run, before anything has started.

    Args:
        sources: of each camera, as `nodes.sources` takes them; empty for bags and running drivers.
        streams: of bags, one per camera, and those of depth maps and sound.
        sounds: of devices that hear the clocks of cameras, as `capture.sound.open_sound` takes them.
        heard: live, devices whose sound others publish.
        shifts: by camera, and of sound by topic, ns: what is added to stamps so that all are roughly in
            master time, and sound goes ahead.
        topics: of running drivers, by key of `graph.topics.TOPICS` and camera.
        encodings: by camera, of raw images whose driver says something else.
        depth_cameras: whose images come with depth maps.
        maps: of depth sensors that stand for themselves, of a capture folder.
        stage: the first stage that is needed, detection or sync.
        extras: what detection and assembly need besides; empty if nothing.
        frame_count: of all cameras together, None if not known; instants: of the longest camera.
        live: devices, in place of recordings.
        namespace: of the graph's nodes and topics.
        publish: what `nodes.listeners.people_node` makes of skeletons for other packages.
        subjects: files of the designated people.
        imus: file with samples by device; empty for bags and running drivers.
        worn: devices on the designated people, in the order of their files.
        until_ns: of a recording: what is stamped then or later is left out; None = nothing is.
        notices: one line each about what was adapted.
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
        """Names of the result's joints, in their order."""
        return self.skeleton.joint_names

    @property
    def stages(self) -> tuple[str, ...]:
        """All stages from the first on; parameters may switch some of them off. Without cameras there are
        bodies alone.
        """
        if not self.rig.cameras:
            return (BODIES,)
        return (*(SOUND if self.devices else ()), *CHAIN[CHAIN.index(self.stage) :])

    @property
    def devices(self) -> tuple[str, ...]:
        """Those whose sound is used."""
        recorded = (stream.camera for stream in self.streams if stream.key == SOUND_KEY)
        return (*(str(sound["device"]) for sound in self.sounds), *recorded, *self.heard)

    @property
    def imu_devices(self) -> tuple[str, ...]:
        """IMUs whose samples come: of a file, of bags; of running drivers all that are worn."""
        recorded = tuple(stream.camera for stream in self.streams if stream.key == IMU_KEY)
        return self.worn if self.live else (*self.imus, *recorded)

    def at(self, owner: str, stamp_ns: int) -> int:
        """Roughly the master time of a stamp of a camera, or of the sound on a topic."""
        return stamp_ns + self.shifts.get(owner, 0)

    def clock_of(self, owner: str) -> str:
        """Whose clock stamps the records of a camera or device; "" = the common one."""
        return self.rig.clock_of(owner)


def require_cameras(rig: Rig, designated: bool = False) -> None:
    """Whether there are cameras enough: two, or one where subjects are given, whose bodies it tells of.

    Raises:
        CalibrationError: if not.
    """
    if len(rig) < (1 if designated else 2):
        raise CalibrationError(
            f"{len(rig)} camera ({', '.join(rig.names)}) is not enough for 3D; add cameras, or "
            "--subject FILE for the body of a designated person, for which one is enough"
        )
