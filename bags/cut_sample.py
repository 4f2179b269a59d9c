"""Cut a small bag from that of a run: rig, skeleton model, and the 2D people of its first second.

python bags/cut_sample.py RUN/bag SAMPLE [--maps] [--seconds S] [--sound-rate HZ]
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import resample_poly

from panoptic_ros.domain import AudioBlock, ViewDetections
from panoptic_ros.io.bags import BagReader, BagWriter
from panoptic_ros.io.messages import bag_messages, from_message, to_message

SECOND = 1_000_000_000
FACTS = ("/rig", "/skeleton_model")


def cut(source: Path, target: Path, maps: bool, seconds: float, sound_rate: int) -> None:
    """Write `target`.

    Args:
        maps: keep score maps; they are most of the size.
        seconds: from the first 2D people on.
        sound_rate: Hz, of the sound up to then; 0: none.
    """
    with BagReader(source) as bag, BagWriter(target) as sample:
        facts = [topic for topic in bag.topics if topic in FACTS]
        people = [topic for topic in bag.topics if topic.endswith("/detections")]
        heard = [topic for topic in bag.topics if topic.endswith("/audio")] if sound_rate else []
        until = min(stamp for _, stamp, _ in bag.messages(*people)) + seconds * SECOND
        rows: list[tuple[int, str, Any]] = [
            (stamp, topic, message) for topic, stamp, message in bag.messages(*facts)
        ]
        for topic, stamp, message in bag.messages(*people):
            if stamp < until:
                view = from_message(message, "ViewDetections")
                rows.append((stamp, topic, to_message(view if maps else _bare(view), bag_messages())))
        for topic in heard:
            blocks = [
                (stamp, from_message(message, "AudioBlock")) for _, stamp, message in bag.messages(topic)
            ]
            rows += [
                (stamp, topic, to_message(block, bag_messages()))
                for stamp, block in _slower(blocks, sound_rate)
                if stamp < until
            ]
        for stamp, topic, message in sorted(rows, key=lambda row: row[0]):
            sample.write(topic, stamp, message)


def _bare(view: ViewDetections) -> ViewDetections:
    return ViewDetections(
        view.camera,
        view.stamp_ns,
        view.frame_number,
        view.image_size,
        view.skeleton_hash,
        view.points,
        view.scores,
        view.person_scores,
    )


def _slower(blocks: list[tuple[int, AudioBlock]], rate: int) -> list[tuple[int, AudioBlock]]:
    """Blocks without a gap at a lower sample rate, 16 bits deep."""
    first = blocks[0][1]
    samples = resample_poly(np.concatenate([block.samples for _, block in blocks]), rate, first.sample_rate)
    coarse = (np.round(samples * 32767.0) / 32768.0).astype(np.float32)
    bounds = [(block.first_sample - first.first_sample) * rate // first.sample_rate for _, block in blocks]
    return [
        (
            stamp,
            replace(
                block,
                stamp_ns=first.stamp_ns + begin * SECOND // rate,
                first_sample=begin,
                sample_rate=rate,
                samples=coarse[begin:end],
            ),
        )
        for (stamp, block), begin, end in zip(blocks, bounds, [*bounds[1:], len(coarse)])
    ]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("source", type=Path)
    parser.add_argument("target", type=Path)
    parser.add_argument("--maps", action="store_true")
    parser.add_argument("--seconds", type=float, default=1.0)
    parser.add_argument("--sound-rate", type=int, default=0)
    given = parser.parse_args()
    cut(given.source, given.target, given.maps, given.seconds, given.sound_rate)
