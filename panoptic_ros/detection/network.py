"""From an image to people in its pixels: preprocessing, session, decoder, and the way back."""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from panoptic_ros.detection.backends.onnx import OnnxNetwork
from panoptic_ros.detection.card import ModelCard
from panoptic_ros.detection.config import DetectionConfig
from panoptic_ros.detection.coordinates import grid_from_net, net_from_model
from panoptic_ros.detection.decoders.center_heads import decode_center_heads
from panoptic_ros.detection.input_size import input_size
from panoptic_ros.detection.model import DetectorModel
from panoptic_ros.detection.people import People, boxes_of_points, drop_duplicates
from panoptic_ros.detection.preprocess import composed, input_tensor, inverted, letterbox
from panoptic_ros.detection.score_maps import PatchSet, gate_radius, merged_patches, quantised

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Finding:
    """What a network finds in one image.

    Args:
        people: in image px, each with at least one joint above the threshold (boxes: none needed).
        patches: score maps, None if there are none.
        scale: net px per image px of the network that finds the people.
    """

    people: People
    patches: PatchSet | None
    scale: float


class FullImageNetwork:
    """A network that takes the whole image and finds everybody at once."""

    def __init__(self, model: DetectorModel, config: DetectionConfig):
        self.card = model.card
        self.config = config
        self.session = OnnxNetwork(model.card, model.onnx_bytes, config.providers, config.threads)
        self.any_size = not model.card.input.size
        self.multiple = model.card.input.multiple
        self.person_px = model.card.person_px

    def find(self, image: Array, side: int) -> Finding:
        """The people in an image (H, W, 3) uint8 BGR, with `side` net px on its longer side.

        Networks of a fixed size ignore `side`.
        """
        card = self.card
        size = card.input.size or input_size(side, (image.shape[1], image.shape[0]), card.input.multiple)
        picture, net_from_image = letterbox(image, (size[0], size[1]), card.input)
        outputs = activated(card, self.session.run(input_tensor([picture], card.input)))
        outputs = {role: values[0] for role, values in outputs.items()}
        people = _decode(card, outputs, self.config.person_threshold)
        people = people.transformed(net_from_model(card))
        if card.joints:
            people = _seen_people(people, self.config)
        patches = None
        if self.config.maps and card.family == "center_heads":
            patches = self._patches(outputs["heat"], people, net_from_image, (size[0], size[1]))
        image_from_net = inverted(net_from_image)
        return Finding(people.transformed(image_from_net), patches, float(net_from_image[1, 1]))

    def _patches(
        self, heat: Array, people: People, net_from_image: Array, net_size: tuple[int, int]
    ) -> PatchSet:
        grid = grid_from_net(self.card, net_size, heat.shape[1:])
        on_grid = people.transformed(grid)
        seen = people.scores >= self.config.joint_threshold
        radius = gate_radius(on_grid.heights())
        patches = merged_patches(quantised(heat, self.config.map_cut), on_grid.points, seen, radius)
        return PatchSet((heat.shape[2], heat.shape[1]), composed(grid, net_from_image), patches)


def activated(card: ModelCard, outputs: Mapping[str, Array]) -> dict[str, Array]:
    """Outputs with the card's activation on those that are scores."""
    if card.activation == "none":
        return dict(outputs)
    return {
        role: 1.0 / (1.0 + np.exp(-np.maximum(values, -80.0))) if role in ("center", "heat") else values
        for role, values in outputs.items()
    }


def _decode(card: ModelCard, outputs: Mapping[str, Array], threshold: float) -> People:
    return decode_center_heads(outputs, card.stride, card.max_people, threshold)


def _seen_people(people: People, config: DetectionConfig) -> People:
    """People with joints above the threshold, each once, with a box that holds these joints."""
    people = people.select(np.flatnonzero((people.scores >= config.joint_threshold).any(axis=1)))
    people = drop_duplicates(people, people.scores >= config.joint_threshold, config.duplicate_overlap)
    if not len(people):
        return people
    around = boxes_of_points(people.points, people.scores >= config.joint_threshold)
    low = np.minimum(people.boxes[:, :2], around[:, :2])
    high = np.maximum(people.boxes[:, 2:], around[:, 2:])
    return replace(people, boxes=np.concatenate([low, high], axis=1))


def make_network(model: DetectorModel, config: DetectionConfig) -> FullImageNetwork:
    """The network of a model's family."""
    return FullImageNetwork(model, config)
