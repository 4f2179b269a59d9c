"""Where images come from: videos, image folders, live devices, capture folders, the demo captures.

Every source is a `FrameSource`: it has a camera's name, an image size and a nominal frame rate, and
hands out `ViewFrame`s in order. Recorded sources give the same frames and stamps every time they
are read; frame i of a video lies at start + i / frame rate, or where the container puts it if the
frame rate varies; images without stamps lie where their numbers say. Timecode and late starts count. Live
sources keep the newest frame only and count the others as dropped.

In: files through PyAV (FFmpeg), devices and URLs through OpenCV (V4L2, FFmpeg). Out: `ViewFrame`s,
BGR, upright (a video's display matrix is obeyed), distorted as the lens saw them; `DepthFrame`s of cameras
with depth maps and of depth sensors that stand for themselves.
Sound has a room of its own, `capture.sound`.

Limits: no hardware trigger, no depth from devices; a capture folder holds one file or folder
of images per camera.
"""

from panoptic_ros.capture.demo import demo_capture
from panoptic_ros.capture.depth_folder import DepthSource, depth_files
from panoptic_ros.capture.depth_sensor import DepthSensorSource, open_depth_sensors
from panoptic_ros.capture.described import Note, open_live, open_recording, open_source
from panoptic_ros.capture.device import DeviceOptions, DeviceSource
from panoptic_ros.capture.folder import (
    CaptureFolder,
    fit_rig,
    folder_stamps,
    open_capture_folder,
    open_files,
    starts_of_files,
)
from panoptic_ros.capture.image_folder import ImageFolderSource
from panoptic_ros.capture.layout import VIDEO_SUFFIXES, find_media, has_media, places_in, videos_in
from panoptic_ros.capture.source import FrameSource
from panoptic_ros.capture.video import VideoSource

__all__ = [
    "VIDEO_SUFFIXES",
    "CaptureFolder",
    "DepthSensorSource",
    "DepthSource",
    "DeviceOptions",
    "DeviceSource",
    "FrameSource",
    "ImageFolderSource",
    "Note",
    "VideoSource",
    "demo_capture",
    "depth_files",
    "find_media",
    "fit_rig",
    "folder_stamps",
    "has_media",
    "open_capture_folder",
    "open_depth_sensors",
    "open_files",
    "open_live",
    "open_recording",
    "open_source",
    "places_in",
    "starts_of_files",
    "videos_in",
]
