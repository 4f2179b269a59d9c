"""A bag with small images and depth maps from a rendered capture, as drivers publish them.

panoptic simulate rendered-2p4v --seed 5 --frames 12 --images --depth --out TAKE
python bags/small_images.py TAKE SAMPLE
"""

from __future__ import annotations

import argparse
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from panoptic_ros.domain import Camera, ViewFrame
from panoptic_ros.geometry import Intrinsics
from panoptic_ros.io.bags import BagWriter
from panoptic_ros.io.messages import (
    bag_messages,
    camera_info_message,
    compressed_image_message,
    to_message,
)
from panoptic_ros.io.messages.images import optical_frame
from panoptic_ros.io.rigs import read_rig
from panoptic_ros.io.stamps import read_stamps

SMALLER = 2  # images; depth maps are half as large again
JPEG_QUALITY = 60


def write(take: Path, target: Path) -> None:
    """Write the bag `target`."""
    rig = read_rig(take / "rig.json")
    small = replace(rig, cameras=tuple(_smaller(camera) for camera in rig.cameras))
    stamps = read_stamps(take / "timestamps.csv")
    family = bag_messages()
    rows: list[tuple[int, str, Any]] = []
    for camera in small.cameras:
        names = sorted((take / camera.name).glob("*.png"))
        for number, (stamp, file) in enumerate(zip(stamps[camera.name].stamps_ns, names)):
            image = cv2.resize(cv2.imread(str(file)), camera.image_size, interpolation=cv2.INTER_AREA)
            frame = ViewFrame(camera.name, stamp, number, image)
            depth = cv2.imread(str(take / f"{camera.name}_depth" / file.name), cv2.IMREAD_UNCHANGED)
            messages = {
                "image_raw/compressed": compressed_image_message(frame, family, JPEG_QUALITY),
                "camera_info": camera_info_message(camera, stamp, family),
                "depth_registered/image_raw/compressedDepth": _packed(camera, stamp, depth),
            }
            rows += [(stamp, f"/{camera.name}/{topic}", message) for topic, message in messages.items()]
    with BagWriter(target) as bag:
        bag.write("/rig", min(at for at, _, _ in rows), to_message(small, family))
        for at, topic, message in sorted(rows, key=lambda row: (row[0], row[1])):
            bag.write(topic, at, message)


def _smaller(camera: Camera) -> Camera:
    """The camera of images that are resized; the centre of the first pixel is (0, 0)."""
    matrix = np.array(camera.intrinsics.matrix) / SMALLER
    matrix[:2, 2] += 0.5 / SMALLER - 0.5
    matrix[2] = [0, 0, 1]
    lens = camera.intrinsics
    width, height = camera.image_size
    return replace(
        camera,
        image_size=(width // SMALLER, height // SMALLER),
        intrinsics=Intrinsics(matrix, lens.distortion, lens.lens),
        covariance=None,
    )


def _packed(camera: Camera, stamp_ns: int, millimetres: Any) -> Any:
    """A quarter of the pixels of each side, as compressed_depth_image_transport packs them."""
    family, step = bag_messages(), 2 * SMALLER
    _, png = cv2.imencode(".png", millimetres[step // 2 :: step, step // 2 :: step])
    data = np.frombuffer(struct.pack("<iff", 0, 0.0, 0.0) + png.tobytes(), np.uint8)
    return family.make(
        "sensor_msgs/msg/CompressedImage",
        header=family.header(stamp_ns, optical_frame(camera.name)),
        format="16UC1; compressedDepth png",
        data=family.sequence(data),
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("take", type=Path)
    parser.add_argument("target", type=Path)
    given = parser.parse_args()
    write(given.take, given.target)
