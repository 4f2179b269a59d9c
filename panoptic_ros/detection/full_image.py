"""Networks on whole images: preprocessing, inference, decoding, and the map back to image pixels."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from panoptic_ros.detection.backends.choice import open_network
from panoptic_ros.detection.card import ModelCard
from panoptic_ros.detection.config import DetectionConfig, with_card_thresholds
from panoptic_ros.detection.coordinates import grid_from_net, net_from_model
from panoptic_ros.detection.decoders.center_heads import decode_center_heads
from panoptic_ros.detection.decoders.points import (
    decode_detections,
    decode_rtmo,
    decode_yolo,
    decode_yolo_end_to_end,
    decode_yolox,
)
from panoptic_ros.detection.input_size import input_size
from panoptic_ros.detection.model import DetectorModel
from panoptic_ros.detection.people import DetectedPeople, boxes_of_points, concatenate, without_duplicates
from panoptic_ros.detection.preprocess import composed, input_tensor, inverted, letterbox
from panoptic_ros.detection.region_maps import RegionMaps, merged_maps
from panoptic_ros.detection.regions import Region
from panoptic_ros.detection.score_maps import PatchSet, gate_radius, merged_patches, quantised

Array = np.ndarray
REGION_VARIANCE = 36.0  # cells^2, search width for a joint in a region: the image size is unknown there
Further = Callable[[DetectedPeople], DetectedPeople]  # returns further people, given those already detected


@dataclass(frozen=True, eq=False)
class ImageDetections:
    """People that a network detects in one image.

    Args:
        people: People in image px, each with at least one joint above the threshold. Boxes are optional.
        patches: Score maps, None if there are none.
        scale: px of the input of the network that detects the people, per px of the image.
    """

    people: DetectedPeople
    patches: PatchSet | None
    scale: float


class FullImageNetwork:
    """Network that takes the whole image and detects all people at once."""

    def __init__(self, model: DetectorModel, config: DetectionConfig):
        self.card = model.card
        self.config = with_card_thresholds(config, model.card)
        self.session = open_network(model.card, model.onnx_bytes, config.providers, config.threads)
        self.any_size = not model.card.input.size
        self.multiple = model.card.input.multiple
        self.person_px = model.card.person_px

    def find(self, image: Array, side: int, maps: bool = True) -> ImageDetections:
        """Detect the people in an image (H, W, 3) uint8 BGR, scaled to `side` px on the longer side.

        Networks of a fixed input size ignore `side`. Without `maps` the finding has no score maps.
        """
        card = self.card
        size = card.input.size or self.size_of(side, image)
        outputs, net_from_image = self._run(image, (size[0], size[1]))
        people = decode_image(card, outputs, (size[0], size[1]), self.config.person_threshold)
        people = people.transformed(net_from_model(card))
        if card.joints:
            people, _ = seen_people(people, self.config)
        patches = None
        if maps and self.config.maps and card.family == "center_heads":
            patches = self._patches(outputs["heat"], people, net_from_image, image.shape, size)
        image_from_net = inverted(net_from_image)
        return ImageDetections(people.transformed(image_from_net), patches, float(net_from_image[1, 1]))

    def size_of(self, side: int, image: Array) -> tuple[int, int]:
        """Return the input size (height, width) px of an image that gets `side` px on its longer side."""
        return input_size(side, (image.shape[1], image.shape[0]), self.card.input.multiple)

    def find_in(
        self, image: Array, regions: Sequence[Region], further: Further | None = None
    ) -> ImageDetections:
        """Detect the people in some regions of an image; for networks that take any input size.

        Args:
            further: Returns further people, given those already detected.

        Returns:
            the people of all regions. `scale` is that of the finest region, 0 if there is no region.
        """
        card, parts, maps = self.card, [], []
        for region in regions:
            people, outputs, net_from_image = self._region(image, region)
            parts.append(people)
            if self.config.maps and card.family == "center_heads":
                grid = grid_from_net(card, region.net_size, outputs["heat"].shape[1:])
                maps.append(RegionMaps(outputs["heat"], composed(grid, net_from_image), region.box[2:]))
        people = self._best_first(concatenate(parts, len(card.joints)))
        if further is not None:
            others = further(people)
            if len(others):
                people = self._best_first(concatenate([people, others], len(card.joints)))
        patches = merged_maps(maps, people, self.config) if maps else None
        scale = max([region.net_size[1] / (region.box[2] - region.box[0]) for region in regions], default=0.0)
        return ImageDetections(people, patches, scale)

    def people_in(self, image: Array, region: Region) -> DetectedPeople:
        """Detect the people in a region of an image, best first, without maps."""
        return self._best_first(self._region(image, region)[0])

    def _best_first(self, people: DetectedPeople) -> DetectedPeople:
        order = np.argsort(-people.person_scores, kind="stable")
        return seen_people(people.select(order), self.config)[0]

    def _region(self, image: Array, region: Region) -> tuple[DetectedPeople, dict[str, Array], Array]:
        """Return the people in a region in px of the image, the outputs by role, and net_from_image."""
        left, top, right, bottom = region.box
        outputs, net_from_cut = self._run(image[top:bottom, left:right], region.net_size, quick=True)
        net_from_image = composed(net_from_cut, np.array([[1.0, 0.0, -left], [0.0, 1.0, -top]]))
        people = decode_image(
            self.card, outputs, region.net_size, self.config.person_threshold, REGION_VARIANCE
        )
        people = people.transformed(net_from_model(self.card)).transformed(inverted(net_from_image))
        return people, outputs, net_from_image

    def _run(
        self, image: Array, size: tuple[int, int], quick: bool = False
    ) -> tuple[dict[str, Array], Array]:
        """Run the network on an image fitted into (height, width).

        Returns:
            outputs by role, and net_from_image (2, 3).
        """
        picture, net_from_image = letterbox(image, size, self.card.input, quick)
        outputs = activated(self.card, self.session.run(input_tensor([picture], self.card.input)))
        return {role: values[0] for role, values in outputs.items()}, net_from_image

    def _patches(
        self,
        heat: Array,
        people: DetectedPeople,
        net_from_image: Array,
        image_shape: tuple[int, ...],
        net_size: tuple[int, ...],
    ) -> PatchSet:
        grid = grid_from_net(self.card, (net_size[0], net_size[1]), heat.shape[1:])
        grid_from_image = composed(grid, net_from_image)
        # Cells beyond the right and lower image border show padding and are not part of the grid.
        border = grid_from_image[:, :2] @ (image_shape[1] - 0.5, image_shape[0] - 0.5) + grid_from_image[:, 2]
        columns, rows = np.minimum(np.ceil(border + 0.5).astype(int), heat.shape[:0:-1])
        on_grid = people.transformed(grid)
        seen = people.scores >= self.config.joint_threshold
        levels = quantised(heat[:, :rows, :columns], self.config.map_cut)
        patches = merged_patches(levels, on_grid.points, seen, gate_radius(on_grid.heights()))
        return PatchSet((int(columns), int(rows)), grid_from_image, patches)


def activated(card: ModelCard, outputs: Mapping[str, Array]) -> dict[str, Array]:
    """Apply the card's activation to the outputs that are scores."""
    if card.activation == "none":
        return dict(outputs)
    return {
        role: 1.0 / (1.0 + np.exp(-np.maximum(values, -80.0))) if role in ("center", "heat") else values
        for role, values in outputs.items()
    }


def decode_image(
    card: ModelCard,
    outputs: Mapping[str, Array],
    net_size: tuple[int, int],
    threshold: float,
    variance: float | None = None,
) -> DetectedPeople:
    """Decode the people of one image, in the network's own coordinates.

    Args:
        variance: See `decode_center_heads`.
    """
    iou, most = card.nms_iou, card.max_people
    if card.family == "center_heads":
        return decode_center_heads(outputs, card.stride, most, threshold, variance)
    if card.variant == "rtmo":
        return decode_rtmo(outputs, threshold, iou, most)
    if card.variant == "yolo":
        return decode_yolo(outputs, threshold, iou, most)
    if card.variant == "yolo_end_to_end":
        return decode_yolo_end_to_end(outputs, threshold, most)
    if card.variant == "yolox":
        return decode_yolox(outputs, net_size, threshold, iou, most)
    return decode_detections(outputs, threshold, iou, most)


def seen_people(people: DetectedPeople, config: DetectionConfig) -> tuple[DetectedPeople, Array]:
    """Return the people with joints above the threshold, without duplicates, and their input indices.

    Their boxes are enlarged to contain these joints. Joints with a position that is not finite count as
    missing.
    """
    placed = np.isfinite(people.points).all(axis=2)
    people = replace(people, scores=np.where(placed, people.scores, 0.0))
    kept = np.flatnonzero((people.scores >= config.joint_threshold).any(axis=1))
    people = people.select(kept)
    seen = people.scores >= config.joint_threshold
    unique = without_duplicates(people, seen, config.duplicate_overlap)
    people, kept, seen = people.select(unique), kept[unique], seen[unique]
    if not len(people):
        return people, kept
    around = boxes_of_points(people.points, seen)
    low = np.minimum(people.boxes[:, :2], around[:, :2])
    high = np.maximum(people.boxes[:, 2:], around[:, 2:])
    return replace(people, boxes=np.concatenate([low, high], axis=1)), kept
