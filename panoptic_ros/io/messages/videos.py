"""Messages that hold packets of a video, which are not read: how to make images of them."""

from __future__ import annotations

# image_transport's plugin by the type of its messages
PLUGINS = {
    "ffmpeg_image_transport_msgs/msg/FFMPEGPacket": "ffmpeg",
    "foxglove_msgs/msg/CompressedVideo": "foxglove",
    "theora_image_transport/msg/Packet": "theora",
}
_WHEN = "of a bag while `ros2 bag play` plays it, and record these"
REMEDY = f"make images of it with `ros2 run image_transport republish`, {_WHEN}"


def is_video(kind: str) -> bool:
    """Return whether messages of a type hold packets of a video."""
    return kind in PLUGINS


def video_told(topic: str, kind: str) -> str:
    """Return the line about such a topic, with the remedy."""
    plugin, base = PLUGINS[kind], topic.rsplit("/", 1)[0]
    words = (
        f"-p in_transport:={plugin} -p out_transport:=compressed -r in/{plugin}:={topic} "
        f"-r out/compressed:={base}/compressed"
    )
    return (
        f"{topic} is compressed video ({kind.split('/')[-1]}), which is not read; make images of it with "
        f"`ros2 run image_transport republish --ros-args {words}`, {_WHEN}"
    )
