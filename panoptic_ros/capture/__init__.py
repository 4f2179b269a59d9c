"""Sources of images: videos, image folders, live devices, capture folders, and the demo captures.

Every source is a `FrameSource`. It has a camera name, an image size and a nominal frame rate, and yields
`ViewFrame`s in order. Recorded sources yield the same frames and timestamps on every reading. Frame i of a
video has the timestamp start + i / frame rate, or the container's time if the frame rate varies. Images
without timestamps are placed by the numbers in their names. Timecode and late starts are taken into account.
Live sources keep only the newest frame and count the others as dropped.

Input: files through PyAV (FFmpeg), devices and URLs through OpenCV (V4L2, FFmpeg). Output: `ViewFrame`s, BGR,
upright (a video's display matrix is applied), with the lens distortion; `DepthFrame`s of cameras with depth
maps and of separate depth sensors. `capture.sound` reads audio.

Limits: no hardware trigger, no depth from live devices. A capture folder holds one file or folder of images
per camera.
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
