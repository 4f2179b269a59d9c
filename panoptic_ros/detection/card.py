"""Model card: everything that the code needs to feed a network and to decode its outputs.

Two networks of one family differ in their cards only. Pixels of the network input have one of two
origins. The origin is the corner of the image (the first pixel's centre is 0.5, 0.5), or the centre of its
first pixel, as in OpenCV. `CoordsCard.origin` states which one the network uses.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from panoptic_ros.errors import ConfigError, nearest, shown

FITS = ("letterbox_topleft", "letterbox_center", "crop")
VARIANTS: dict[str, tuple[str, ...]] = {
    "center_heads": ("",),  # MoveNet MultiPose: person centres, score maps, offsets
    "single_heads": ("",),  # MoveNet SinglePose, on crops
    "simcc": ("",),  # RTMPose: one distribution per axis, on crops
    "heatmap": ("quarter", "dark"),  # HRNet, ViTPose: maps of one person, on crops
    "points": ("rtmo", "yolo", "yolo_end_to_end"),  # keypoints of all people at once
    "boxes": ("yolox", "detections", "detections_labels"),  # people's boxes only, for the families on crops
}
CROP_FAMILIES = ("single_heads", "simcc", "heatmap")
PERSON_DETECTORS = ("center_heads", "points", "boxes")


@dataclass(frozen=True, kw_only=True)
class InputCard:
    """Description of the input tensor.

    Args:
        size: (height, width) px, or () if the network takes any size.
        multiple: Sizes are multiples of this, if the network takes any size.
        mean, std: Per channel in the network's colour order, of values 0..255.
        fit: Method that fits an image into the input.
        pad: Grey value of the part of the input that the image does not fill.
        crop_padding: Size of a crop relative to the person's box.
    """

    name: str = "input"
    layout: str = "NCHW"
    dtype: str = "float32"
    color: str = "RGB"
    mean: tuple[float, ...] = (0.0, 0.0, 0.0)
    std: tuple[float, ...] = (1.0, 1.0, 1.0)
    size: tuple[int, ...] = ()
    multiple: int = 32
    fit: str = "letterbox_topleft"
    pad: int = 114
    crop_padding: float = 1.25

    def __post_init__(self) -> None:
        _convert(self, "input")
        _one_of("input.layout", self.layout, ("NHWC", "NCHW"))
        _one_of("input.dtype", self.dtype, ("uint8", "float32"))
        _one_of("input.color", self.color, ("RGB", "BGR"))
        _one_of("input.fit", self.fit, FITS)
        _require(len(self.mean) == len(self.std) == 3, "input.mean and input.std need three values")
        _require(all(value > 0.0 for value in self.std), "input.std must be positive")
        _require(len(self.size) in (0, 2), "input.size is [height, width] or dynamic")
        _require(all(32 <= side <= 8192 for side in self.size), "input.size is outside of 32..8192")
        _require(1 <= self.multiple <= 256, "input.multiple is outside of 1..256")
        _require(0 <= self.pad <= 255, "input.pad is outside of 0..255")
        _require(1.0 <= self.crop_padding <= 3.0, "input.crop_padding is outside of 1..3")


@dataclass(frozen=True, kw_only=True)
class CoordsCard:
    """Meaning of the network's coordinates.

    Args:
        origin: "corner" or "center", see the module.
        shift_px: (x, y) px of the network input to add to the network's coordinates.
        udp: Sizes are measured between pixel centres, w - 1 (Huang et al. 2020), in crops and maps.
    """

    origin: str = "center"
    shift_px: tuple[float, ...] = (0.0, 0.0)
    udp: bool = False

    def __post_init__(self) -> None:
        _convert(self, "coords")
        _one_of("coords.origin", self.origin, ("corner", "center"))
        _require(len(self.shift_px) == 2, "coords.shift_px needs two values")


@dataclass(frozen=True, kw_only=True)
class ModelCard:
    """Description of one network.

    Args:
        family, variant: Decoder of the outputs.
        file: The ONNX file, relative to the card; "" = in the cache of fetched models.
        sha256: Hash of that file; "" = not checked.
        output: Tensor name by role in the family.
        stride: px of the network input per cell of the score maps.
        split: Bins per px of the network input (simcc).
        joints: Names of the network's joints; () for boxes.
        joint_bias: m for each joint, measured standard deviation per axis of the constant bias relative to
            the joint centres of people; () = unknown.
        person_px: Range of heights, px of the network input, in which people are detected best.
        person_threshold: People with lower scores are dropped, unless the stage overrides it.
        joint_threshold: The same for joints.
        nms_iou: Intersection over union above which two boxes are one person, if the network leaves that
            open.
        detector: Card of the network that detects the people for a family on crops. "" = none, the whole
            image is one crop.
    """

    name: str
    family: str
    variant: str = ""
    licence: str = ""
    source: str = ""
    file: str = ""
    sha256: str = ""
    input: InputCard = field(default_factory=InputCard)
    output: Mapping[str, str] = field(default_factory=dict)
    coords: CoordsCard = field(default_factory=CoordsCard)
    stride: int = 4
    split: float = 2.0
    activation: str = "none"
    joints: tuple[str, ...] = ()
    joint_bias: tuple[float, ...] = ()
    max_people: int = 12
    person_px: tuple[float, ...] = (70.0, 220.0)
    person_threshold: float = 0.1
    joint_threshold: float = 0.13
    nms_iou: float = 0.5
    detector: str = ""

    def __post_init__(self) -> None:
        _convert(self, "")
        _require(bool(self.name), "name is empty")
        _one_of("family", self.family, tuple(VARIANTS))
        _one_of("variant", self.variant, VARIANTS[self.family])
        _one_of("activation", self.activation, ("none", "sigmoid"))
        _require(self.stride >= 1, "stride is below 1")
        _require(0.0 < self.split <= 16.0, "split is outside of 0..16")
        _require(1 <= self.max_people <= 1000, "max_people is outside of 1..1000")
        _require(
            len(self.person_px) == 2 and 0 < self.person_px[0] < self.person_px[1],
            "person_px is [smallest, largest]",
        )
        _require(0.0 <= self.person_threshold <= 1.0, "person_threshold is outside of 0..1")
        _require(0.0 <= self.joint_threshold <= 1.0, "joint_threshold is outside of 0..1")
        _require(0.0 < self.nms_iou <= 1.0, "nms_iou is outside of 0..1")
        _require(len(self.sha256) in (0, 64), "sha256 is not 64 hex digits")
        _require(bool(self.joints) != (self.family == "boxes"), "joints: all families but boxes have some")
        _require(len(self.joint_bias) in (0, len(self.joints)), "joint_bias: one length for each joint")
        _require(all(0.0 <= bias <= 1.0 for bias in self.joint_bias), "joint_bias is outside of 0..1 m")
        on_crops = self.family in CROP_FAMILIES
        _require(
            on_crops == (self.input.fit == "crop"),
            f"input.fit = {shown(self.input.fit)} does not go with family {self.family}",
        )
        _require(bool(self.input.size) or not on_crops, "input.size: crops need one")
        _require(on_crops or not self.detector, f"detector: family {self.family} needs none")
        roles = set(expected_shapes(self))
        _require(set(self.output) == roles, f"output must name the tensors {', '.join(sorted(roles))}")


def card_from_mapping(document: Mapping[str, Any]) -> ModelCard:
    """Return the card for the plain values of a file.

    Raises:
        ConfigError: naming the entry that is unknown, missing, of the wrong type or out of range.
    """
    values = dict(document)
    name = values.get("name", "?")
    try:
        for key, kind in (("input", InputCard), ("coords", CoordsCard)):
            part = values.get(key, {})
            _require(isinstance(part, Mapping), f"{key} is not a mapping")
            part = dict(part)
            if part.get("size") == "dynamic":
                part["size"] = ()
            values[key] = _construct(kind, part, f"{key}.")
        card: ModelCard = _construct(ModelCard, values, "")
        return card
    except ConfigError as error:
        raise ConfigError(f"model card {shown(name)}: {error}") from None


def expected_shapes(card: ModelCard) -> dict[str, tuple[int | None, ...]]:
    """Return the shape of each output tensor by role; None = any size."""
    joints = len(card.joints)
    heads: dict[str, tuple[int | None, ...]] = {
        "center": (None, 1, None, None),
        "heat": (None, joints, None, None),
        "regress": (None, 2 * joints, None, None),
        "offset": (None, 2 * joints, None, None),
    }
    boxes = {"box_scale": (None, 2, None, None), "box_offset": (None, 2, None, None)}
    height, width = card.input.size or (0, 0)
    tables: dict[str, dict[str, tuple[int | None, ...]]] = {
        "center_heads": {**heads, **boxes},
        "single_heads": heads,
        "simcc": {
            "x": (None, joints, round(width * card.split)),
            "y": (None, joints, round(height * card.split)),
        },
        "heatmap": {"heat": (None, joints, height // card.stride, width // card.stride)},
        "rtmo": {"boxes": (None, None, 5), "points": (None, None, joints, 3)},
        "yolo": {"people": (None, 5 + 3 * joints, None)},
        "yolo_end_to_end": {"people": (None, None, 6 + 3 * joints)},
        "yolox": {"people": (None, None, None)},
        "detections": {"boxes": (None, None, 5)},
        "detections_labels": {"boxes": (None, None, 5), "labels": (None, None)},
    }
    return tables[card.variant if card.family in ("points", "boxes") else card.family]


def _construct(kind: Any, values: Mapping[str, Any], where: str) -> Any:
    fields = {item.name: item for item in dataclasses.fields(kind)}
    known = [*fields, *(() if where else ("fetch",))]  # "fetch" states the source of the model
    for key in values:
        _require(key in fields, f"unknown entry {shown(where + str(key))}; {nearest(key, known)}")
    for key, item in fields.items():
        needed = item.default is dataclasses.MISSING and item.default_factory is dataclasses.MISSING
        _require(key in values or not needed, f"entry {shown(where + key)} is missing")
    return kind(**values)


def _convert(card: Any, where: str) -> None:
    """Convert lists to tuples and ints to floats where the field needs it; refuse other types."""
    for item in dataclasses.fields(card):
        value = getattr(card, item.name)
        label = f"{where}.{item.name}" if where else item.name
        kind = str(item.type)
        if kind.startswith("tuple"):
            inner = {"int": int, "str": str, "float": float}[kind[6:].split(",")[0]]
            _require(isinstance(value, (list, tuple)), f"{label} = {shown(value)} is not a list")
            value = tuple(_scalar(inner, entry, label) for entry in value)
        elif kind in ("int", "float", "str", "bool"):
            value = _scalar({"int": int, "float": float, "str": str, "bool": bool}[kind], value, label)
        elif kind.startswith("Mapping"):
            _require(isinstance(value, Mapping), f"{label} = {shown(value)} is not a mapping")
            value = {str(key): _scalar(str, entry, label) for key, entry in value.items()}
        object.__setattr__(card, item.name, value)


def _scalar(kind: type, value: Any, label: str) -> Any:
    if kind is float and type(value) is int and value.bit_length() < 1024:  # a float can hold it
        value = float(value)
    _require(type(value) is kind, f"{label} = {shown(value)} is not a {kind.__name__}")
    return value


def _one_of(label: str, value: str, choices: tuple[str, ...]) -> None:
    _require(value in choices, f"{label} = {shown(value)} is none of {', '.join(map(repr, choices))}")


def _require(condition: bool, text: str) -> None:
    if not condition:
        raise ConfigError(text)
