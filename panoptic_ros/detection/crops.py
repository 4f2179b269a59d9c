"""Networks that see one person at a time: crops round the people that another network detected."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import cv2
import numpy as np

from panoptic_ros.detection.backends.choice import open_network
from panoptic_ros.detection.card import ModelCard
from panoptic_ros.detection.config import DetectionConfig, with_card_thresholds
from panoptic_ros.detection.coordinates import grid_from_net, net_from_model
from panoptic_ros.detection.decoders.heatmap import decode_heatmap
from panoptic_ros.detection.decoders.simcc import decode_simcc, simcc_maps
from panoptic_ros.detection.decoders.single_heads import decode_single_heads
from panoptic_ros.detection.full_image import FullImageNetwork, ImageDetections, activated, seen_people
from panoptic_ros.detection.model import DetectorModel
from panoptic_ros.detection.people import DetectedPeople, concatenate
from panoptic_ros.detection.preprocess import composed, crop, input_tensor, inverted
from panoptic_ros.detection.score_maps import (
    MapPatch,
    PatchArrays,
    PatchSet,
    gate_radius,
    gated,
    person_patches,
    quantised,
)

Array = np.ndarray
LONGEST_GRID = 640  # cells: greatest longer side of the common grid of an image's maps


@dataclass(frozen=True, eq=False)
class CropOutput:
    """Network outputs for one crop, and net_from_image (2, 3)."""

    outputs: Mapping[str, Array]
    net_from_image: Array


class CropNetwork:
    """Network on crops. Another network detects the people; without it, the whole image is one crop."""

    def __init__(self, model: DetectorModel, config: DetectionConfig):
        self.card = model.card
        self.config = with_card_thresholds(config, model.card)
        self.session = open_network(model.card, model.onnx_bytes, config.providers, config.threads)
        self.finder = None
        if model.person_detector is not None:
            self.finder = FullImageNetwork(model.person_detector, replace(config, maps=False))
        self.any_size = self.finder is not None and self.finder.any_size
        self.multiple = self.finder.multiple if self.finder is not None else 32
        self.person_px = self.finder.person_px if self.finder is not None else model.card.person_px

    def find(self, image: Array, side: int) -> ImageDetections:
        """Detect the people in an image (H, W, 3) uint8 BGR.

        Args:
            side: Longer side of the input of the network that detects the people, px.
        """
        boxes, box_scores, scale = self._boxes(image, side)
        looks = self._look(image, boxes)
        parts = [self._person(look, score) for look, score in zip(looks, box_scores)]
        everybody = concatenate(parts, len(self.card.joints))
        order = np.argsort(-everybody.person_scores, kind="stable")
        people, kept = seen_people(everybody.select(order), self.config)
        patches = None
        if self.config.maps:
            patches = self._patches(image, people, [looks[order[index]] for index in kept])
        return ImageDetections(people, patches, scale)

    def _boxes(self, image: Array, side: int) -> tuple[Array, Array, float]:
        height, width = image.shape[:2]
        if self.finder is None:
            padding = self.card.input.crop_padding  # makes the crop equal to the image
            centre = np.array([0.5 * (width - 1), 0.5 * (height - 1)])
            half = 0.5 * np.array([width, height]) / padding
            scale = min(self.card.input.size[0] / height, self.card.input.size[1] / width)
            return np.concatenate([centre - half, centre + half])[None], np.ones(1), scale
        found = self.finder.find(image, side)
        return found.people.boxes, found.people.person_scores, found.scale

    def _look(self, image: Array, boxes: Array) -> list[CropOutput]:
        """Run the network on the surroundings of boxes (P, 4), in batches as large as it takes."""
        card = self.card
        cuts = [crop(image, box, card.input, card.coords) for box in boxes]
        step = self.session.batch_limit or max(len(cuts), 1)
        looks = []
        for start in range(0, len(cuts), step):
            batch = cuts[start : start + step]
            pictures = [picture for picture, _ in batch]
            pictures += [pictures[-1]] * (step - len(batch))  # fixed batch sizes must be filled
            outputs = activated(card, self.session.run(input_tensor(pictures, card.input)))
            for index, (_, net_from_image) in enumerate(batch):
                own = {role: values[index] for role, values in outputs.items()}
                looks.append(CropOutput(own, net_from_image))
        return looks

    def _person(self, look: CropOutput, box_score: float) -> DetectedPeople:
        """Decode the one person of a crop, in image px.

        The person score is the box score times the mean score of the joints above the threshold.
        The person threshold applies to the box alone, so that low joint scores do not drop a sure person.
        """
        points, scores = decode_crop(self.card, look.outputs)
        counted = scores >= self.config.joint_threshold
        score = float(scores[counted].mean()) * box_score if counted.any() else 0.0
        people = DetectedPeople(
            points[None],
            scores[None],
            np.array([score]),
            np.concatenate([points.min(axis=0), points.max(axis=0)])[None],
        )
        return people.transformed(inverted(look.net_from_image))

    def _patches(self, image: Array, people: DetectedPeople, looks: list[CropOutput]) -> PatchSet:
        """Return the maps of all people on one common grid, about as fine as that of the finest crop."""
        height, width = image.shape[:2]
        grids = [composed(self._grid_from_net(look), look.net_from_image) for look in looks]
        finest = max([grid[0, 0] for grid in grids], default=0.125)
        scale = min(finest, LONGEST_GRID / max(width, height))
        common = np.array([[scale, 0.0, 0.5 * scale - 0.5], [0.0, scale, 0.5 * scale - 0.5]])
        size = (int(np.ceil(width * scale)), int(np.ceil(height * scale)))
        patches: list[MapPatch] = []
        cells = people.transformed(common)
        seen = people.scores >= self.config.joint_threshold
        radius = gate_radius(cells.heights())
        for person, look in enumerate(looks):
            corner, maps = self._resampled(look, common, size)
            levels = quantised(maps, self.config.map_cut)
            if self.card.family == "single_heads":  # its maps show all people in the crop
                own = cells.points[person] - corner
                levels = gated(levels, own, seen[person], radius[person])
            patches += person_patches(levels, person, corner)
        return PatchSet(size, common, PatchArrays.of(patches))

    def _grid_from_net(self, look: CropOutput) -> Array:
        height, width = self.card.input.size
        if self.card.family == "simcc":
            grid = (height // self.card.stride, width // self.card.stride)
        else:
            grid = look.outputs["heat"].shape[1:]
        return grid_from_net(self.card, (height, width), grid)

    def _resampled(
        self, look: CropOutput, common: Array, size: tuple[int, int]
    ) -> tuple[tuple[int, int], Array]:
        """Return the maps (K, rows, columns) of a crop on the common grid, and their first column and row."""
        height, width = self.card.input.size
        common_from_net = composed(common, inverted(look.net_from_image))
        low = np.floor(common_from_net[:, 2]).astype(int)
        high = np.ceil(common_from_net[:, :2] @ (width - 1, height - 1) + common_from_net[:, 2]) + 1
        left, top = np.clip(low, 0, np.array(size) - 1)
        right, bottom = np.clip(high.astype(int), (left + 1, top + 1), size)
        net_from_common = inverted(common_from_net)
        if self.card.family == "simcc":
            columns = net_from_common[0, 0] * np.arange(left, right) + net_from_common[0, 2]
            rows = net_from_common[1, 1] * np.arange(top, bottom) + net_from_common[1, 2]
            across, down = look.outputs["x"], look.outputs["y"]
            return (left, top), simcc_maps(across, down, columns, rows, self.card.split)
        window = np.array([[1.0, 0.0, left], [0.0, 1.0, top]])
        cells = composed(self._grid_from_net(look), composed(net_from_common, window))
        planes = [
            cv2.warpAffine(
                plane,
                cells,
                (int(right - left), int(bottom - top)),
                flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            )
            for plane in look.outputs["heat"]
        ]
        return (left, top), np.stack(planes)


def decode_crop(card: ModelCard, outputs: Mapping[str, Array]) -> tuple[Array, Array]:
    """Decode joints (K, 2) and scores (K,) of a crop.

    The joints are in px of the crop; the centre of its first pixel is the origin.
    """
    if card.family == "single_heads":
        points, scores = decode_single_heads(outputs, card.stride)
    elif card.family == "simcc":
        points, scores = decode_simcc(outputs["x"], outputs["y"], card.split)
    else:
        cells, scores = decode_heatmap(outputs["heat"], card.variant)
        net_size = (card.input.size[0], card.input.size[1])
        net = inverted(grid_from_net(card, net_size, outputs["heat"].shape[1:]))
        return cells @ net[:, :2].T + net[:, 2], scores
    affine = net_from_model(card)
    return points @ affine[:, :2].T + affine[:, 2], np.clip(scores, 0.0, 1.0)
