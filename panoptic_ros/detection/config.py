"""Parameters of detection."""

from __future__ import annotations

from dataclasses import dataclass, replace

from panoptic_ros.detection.card import ModelCard
from panoptic_ros.params import Config, param


@dataclass(frozen=True, kw_only=True)
class DetectionConfig(Config):
    """Configuration of person detection in one image."""

    model: str = param(
        "movenet-multipose",
        doc="Name of an installed model card, or path of a card (YAML) or ONNX file.",
        when="you have a better network, or need hands and faces.",
    )
    providers: tuple[str, ...] = param(
        (),
        doc="Execution providers of onnxruntime in order of preference; empty = the CPU. If onnxruntime "
        "lacks OpenVINO's provider, the package openvino runs it, in bfloat16 if the CPU supports that.",
        when="`panoptic doctor` finds a faster one: CUDAExecutionProvider, CPUExecutionProvider.",
    )
    threads: int = param(
        1,
        ge=1,
        le=64,
        doc="Threads inside one network operator; more than one helps on idle machines only.",
        when="the machine has more cores than cameras.",
    )
    person_threshold: float = param(
        -1.0,
        ge=-1.0,
        le=1.0,
        doc="Score below which a person is dropped; negative = threshold of the model card (0.1 for the "
        "default: low, as the fusion of the views removes false detections).",
    )
    joint_threshold: float = param(
        -1.0,
        ge=-1.0,
        le=1.0,
        doc="Score below which a joint is missing; negative = threshold of the model card (0.13 for the "
        "default).",
    )
    looks_per_s: float = param(
        0.0,
        unit="1/s",
        ge=0.0,
        le=240.0,
        doc="Rate at which the network runs on each camera, in turn over the rig. Between its runs, "
        "optical flow propagates 2D people from image to image. 0 = at every image.",
        when="processors are too slow for your cameras: 8 is nearly as accurate as every image.",
    )
    budget: float = param(
        0.0,
        ge=0.0,
        le=1.0,
        doc="Live: share of the cores that detection may use. The measured cost of network runs decides "
        "their rate and the height of people in regions; both are reported on /diagnostics. Until the "
        "cost is known, looks_per_s applies. 0 = no limit. Recordings always use looks_per_s.",
        when="cameras deliver more images than processors can handle: 0.6.",
    )
    regions: str = param(
        "auto",
        choices=("auto", "on", "off"),
        doc="Regions around expected people as input of the network, and whole images in turn for "
        "newcomers. auto = only if network runs are rationed (looks_per_s, budget). on, at every image: "
        "half the time.",
    )
    region_height: int = param(
        220,
        ge=64,
        le=1024,
        unit="px",
        doc="Greatest height of the tallest person of a region in the network's input. Less is faster and "
        "less accurate.",
    )
    map_cut: float = param(
        0.05, ge=0.004, le=0.9, doc="Score below which a value of a score map is 0 and not transmitted."
    )
    maps: bool = param(True, doc="Transmit score maps, if the network has them.")
    input_side: int = param(
        640,
        ge=0,
        le=4096,
        unit="px",
        doc="Longer side of the network's input at the start, if the network accepts any size; 0 = try "
        "several.",
    )
    adapt_input: bool = param(
        True, doc="Adapt the size of the input to the size of the people in each camera."
    )
    smallest_input: int = param(
        160, ge=32, le=4096, unit="px", doc="Least length of the longer side of the input."
    )
    largest_input: int = param(
        960, ge=32, le=4096, unit="px", doc="Greatest length of the longer side of the input."
    )
    duplicate_overlap: float = param(
        0.7,
        ge=0.0,
        le=1.0,
        doc="Similarity of the joints of two 2D people above which the one with the lower score is "
        "dropped; 1 = never.",
    )
    up: tuple[float, ...] = param(
        (),
        doc="Up direction of the world, x, y, z. Images of cameras on their side or upside down are "
        "rotated upright for the network. Empty = direction that the rig states; 0, 0, 0 = unknown, no "
        "image is rotated.",
    )
    depth_margin: float = param(
        1.0,
        unit="m",
        ge=0.0,
        le=100.0,
        doc="With depth maps: greatest distance behind the measured surface at which a joint counts as "
        "visible. Networks also locate joints behind the person's own arm, or just behind another person. "
        "Above 65: no joint is hidden.",
    )

    @property
    def guided(self) -> bool:
        """Return whether tracks decide which regions the network runs on."""
        return self.regions == "on" or (self.regions == "auto" and self.rationed)

    @property
    def rationed(self) -> bool:
        """Return whether the network skips some images."""
        return self.looks_per_s > 0.0 or self.budget > 0.0


def with_card_thresholds(config: DetectionConfig, card: ModelCard) -> DetectionConfig:
    """Return the configuration with the card's thresholds where it leaves them open."""
    person, joint = config.person_threshold, config.joint_threshold
    return replace(
        config,
        person_threshold=card.person_threshold if person < 0.0 else person,
        joint_threshold=card.joint_threshold if joint < 0.0 else joint,
    )
