"""Frozen records with identity: cameras, rigs, skeleton models, and the records that travel between stages.

Letters of array shapes: C cameras, J joints, P people, N proposals, M parts, H W pixels. Records check shapes
and values on construction. They hold read-only arrays: copies, unless an array is read-only already. Images
and depth maps are read-only views instead. Missing joints are NaN with score 0.
"""

from panoptic_ros.domain.appearance import ViewAppearance
from panoptic_ros.domain.association import (
    AssociationSet,
    Evidence,
    Groups,
    Prediction,
    ProposalSet,
    TrackSet,
)
from panoptic_ros.domain.bias_table import BiasTable
from panoptic_ros.domain.bodies import BodySource, BodyStateSet, ImuSample
from panoptic_ros.domain.camera import Camera
from panoptic_ros.domain.depth_sensor import DepthSensor
from panoptic_ros.domain.designation import SubjectSet
from panoptic_ros.domain.detections import (
    DepthFrame,
    DetectionSet,
    EndOfStream,
    Preview,
    ScoreMaps,
    ViewDetections,
    ViewFrame,
)
from panoptic_ros.domain.occluders import Occluders
from panoptic_ros.domain.patches import PartMotions, PatchTracks, PatchTrajectories
from panoptic_ros.domain.poses import JointState, Person, PoseSet, RefinedPoseSet, TrackedPoseSet
from panoptic_ros.domain.rig import NO_CAMERAS, Rig
from panoptic_ros.domain.skeleton import JointMap, SkeletonModel
from panoptic_ros.domain.time import (
    AudioBlock,
    ClockModel,
    FrameRate,
    StampLine,
    Timecode,
    TimecodeReading,
)
from panoptic_ros.domain.time_shift import TimeShift
from panoptic_ros.domain.view_sources import ViewSources
from panoptic_ros.domain.visibility import VisibilityLimit

__all__ = [
    "NO_CAMERAS",
    "AssociationSet",
    "AudioBlock",
    "BiasTable",
    "BodySource",
    "BodyStateSet",
    "Camera",
    "ClockModel",
    "DepthFrame",
    "DepthSensor",
    "DetectionSet",
    "EndOfStream",
    "Evidence",
    "FrameRate",
    "Groups",
    "ImuSample",
    "JointMap",
    "JointState",
    "Occluders",
    "PartMotions",
    "PatchTracks",
    "PatchTrajectories",
    "Person",
    "PoseSet",
    "Prediction",
    "Preview",
    "ProposalSet",
    "RefinedPoseSet",
    "Rig",
    "ScoreMaps",
    "SkeletonModel",
    "StampLine",
    "SubjectSet",
    "TimeShift",
    "Timecode",
    "TimecodeReading",
    "TrackSet",
    "TrackedPoseSet",
    "ViewAppearance",
    "ViewDetections",
    "ViewFrame",
    "ViewSources",
    "VisibilityLimit",
]
