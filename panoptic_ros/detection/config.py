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
        doc="Execution providers of onnxruntime in order of preference; empty = the CPU. OpenVINO's is run "
        "by the package openvino where onnxruntime lacks it, in bfloat16 where the CPU has that.",
        when="`panoptic doctor` finds one that is quicker: CUDAExecutionProvider, CPUExecutionProvider.",
    )
    threads: int = param(
        1,
        ge=1,
        le=64,
        doc="Threads inside one network operator; more than one pays on idle machines only.",
        when="the machine has more cores than cameras.",
    )
    person_threshold: float = param(
        -1.0,
        ge=-1.0,
        le=1.0,
        doc="People with lower scores are dropped; negative = as the model card says (0.1 for the default: "
        "low, as fusing the views sorts out the rest).",
    )
    joint_threshold: float = param(
        -1.0,
        ge=-1.0,
        le=1.0,
        doc="Joints with lower scores are missing; negative = as the model card says (0.13 for the default).",
    )
    looks_per_s: float = param(
        0.0,
        unit="1/s",
        ge=0.0,
        le=240.0,
        doc="How often a second the network looks at each camera, in turn over the rig; in between, 2D "
        "people are carried from image to image by optical flow. 0 = at every image.",
        when="processors are too slow for your cameras: 8 is nearly as accurate as every image.",
    )
    budget: float = param(
        0.0,
        ge=0.0,
        le=1.0,
        doc="Live: share of the cores that detection may use. It then chooses how often the network looks at "
        "the cameras, and how tall people are in regions, from what looks cost, and says so on /diagnostics; "
        "looks_per_s counts until that is known. 0 = no limit. Recordings are looked at as looks_per_s says.",
        when="cameras give more images than processors can work on: 0.6.",
    )
    regions: str = param(
        "auto",
        choices=("auto", "on", "off"),
        doc="Whether the network looks where tracked people should be, and at whole images in turn for "
        "newcomers; auto = where looks are rationed (looks_per_s, budget). On at every image: half the time.",
    )
    region_height: int = param(
        220,
        ge=64,
        le=1024,
        unit="px",
        doc="Regions: height of the tallest person of a region in the network's input, at most. Less is "
        "quicker and less accurate.",
    )
    map_cut: float = param(
        0.05, ge=0.004, le=0.9, doc="Values of score maps below this are 0 and not carried."
    )
    maps: bool = param(True, doc="Carry score maps, where the network has them.")
    input_side: int = param(
        640,
        ge=0,
        le=4096,
        unit="px",
        doc="Longer side of the network's input at the start, if it takes any size; 0 = try several.",
    )
    adapt_input: bool = param(
        True, doc="Follow the size of the people of each camera with the size of the input."
    )
    smallest_input: int = param(160, ge=32, le=4096, unit="px", doc="Least longer side of the input.")
    largest_input: int = param(960, ge=32, le=4096, unit="px", doc="Greatest longer side of the input.")
    duplicate_overlap: float = param(
        0.7,
        ge=0.0,
        le=1.0,
        doc="Someone whose joints coincide this much with those of a better person is dropped; 1 = never.",
    )
    up: tuple[float, ...] = param(
        (),
        doc="Direction of the world that is up, x, y, z: images of cameras on their side or upside down are "
        "turned upright for the network. Empty = as the rig states; 0, 0, 0 = not known, nothing is turned.",
    )
    depth_margin: float = param(
        1.0,
        unit="m",
        ge=0.0,
        le=100.0,
        doc="With depth maps: a camera sees a joint that lies so little behind the measured surface, as nets "
        "know joints behind the person's own arm, or just behind somebody. Above 65: nothing is hidden.",
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
