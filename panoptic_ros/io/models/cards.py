"""Read model cards from YAML: installed ones in config/models, and the user's own files."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from panoptic_ros.detection.card import ModelCard, card_from_mapping
from panoptic_ros.errors import ConfigError, UsageError, nearest, shown
from panoptic_ros.io.documents import read_yaml
from panoptic_ros.io.loading import parsing
from panoptic_ros.io.resources import cache_folder, share_folder
from panoptic_ros.io.skeletons import load_skeleton

DEFAULT_MODEL = "movenet-multipose"


@dataclass(frozen=True)
class PackedFile:
    """A file inside a package, with its expected SHA-256."""

    member: str
    sha256: str


@dataclass(frozen=True)
class ModelOrigin:
    """Source of a model that is converted here: an npm package and two files in it.

    Args:
        mean_outputs: mean magnitude of each output, by role, for the image of `check.made_picture`.
    """

    package: str
    topology: PackedFile
    weights: PackedFile
    mean_outputs: Mapping[str, float]


@dataclass(frozen=True)
class CardFile:
    """A model card, its file, and the source of its model if `fetch` supports it.

    Args:
        named: the ONNX file, if the user named it instead of the card.
    """

    card: ModelCard
    path: Path
    origin: ModelOrigin | None
    named: Path | None = None

    @property
    def model_path(self) -> Path:
        """Return the path of the ONNX file: the named one, the card's, or the one in the cache."""
        if self.named is not None:
            return self.named
        if self.card.file:
            return self.path.parent / Path(self.card.file).expanduser()
        return cache_folder() / "models" / f"{self.card.name}.onnx"


def card_names() -> tuple[str, ...]:
    """Return the names of the installed cards, the default first."""
    names = sorted(path.stem for path in (share_folder() / "config" / "models").glob("*.yaml"))
    return tuple(sorted(names, key=lambda name: name != DEFAULT_MODEL))


def read_card(name_or_path: str, beside: Path | None = None) -> CardFile:
    """Read the card of an installed model, of a YAML file, or beside an ONNX file with the same name.

    Args:
        beside: base folder of relative paths; None = the working directory.

    Raises:
        UsageError: if the name is unknown, or the ONNX file has no card.
        ConfigError: if the card is invalid, naming file and entry.
    """
    path = Path(name_or_path).expanduser()
    named = path if path.suffix == ".onnx" else None
    if named is not None:
        path = path.with_suffix(".yaml")
        if not path.is_file():
            raise UsageError(
                f"{name_or_path} needs a model card {path.name} beside it that describes its format; copy "
                f"the one of the same family from {share_folder() / 'config' / 'models'}"
            )
    if path.suffix not in (".yaml", ".yml"):
        if name_or_path not in card_names():
            raise UsageError(
                f"unknown model {shown(name_or_path)}; there are {', '.join(card_names())}, "
                "or the path of a model card (YAML)"
            )
        path = share_folder() / "config" / "models" / f"{name_or_path}.yaml"
    elif beside is not None:
        path = beside / path
    document = read_yaml(path)
    if not isinstance(document, dict):
        raise ConfigError(f"{path} is not a model card")
    try:
        with parsing("the card", ConfigError):
            return _card_file(document, path, named)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None


def _card_file(document: dict[str, Any], path: Path, named: Path | None) -> CardFile:
    values = dict(document)
    origin = values.pop("fetch", None)
    if isinstance(values.get("joints"), str):
        values["joints"] = load_skeleton(values["joints"]).joint_names
    return CardFile(card_from_mapping(values), path, None if origin is None else _origin(origin), named)


def _origin(values: Any) -> ModelOrigin:
    keys = {"package", "topology", "weights", "mean_outputs"}
    _refuse_unknown(values, keys, "fetch")
    good = isinstance(values, dict) and set(values) == keys
    if not good or not isinstance(values["package"], str) or not isinstance(values["mean_outputs"], dict):
        raise ConfigError(
            "fetch needs package, topology and weights (each with member and sha256) and mean_outputs"
        )
    topology, weights = (_packed(key, values[key]) for key in ("topology", "weights"))
    means = {str(key): float(value) for key, value in values["mean_outputs"].items()}
    return ModelOrigin(values["package"], topology, weights, means)


def _refuse_unknown(values: Any, keys: Collection[str], where: str) -> None:
    """Refuse a table with an unknown key.

    Raises:
        ConfigError: naming the key.
    """
    for key in values if isinstance(values, dict) else ():
        if key not in keys:
            raise ConfigError(f"{where}: unknown entry {shown(key)}; {nearest(key, keys)}")


def _packed(key: str, entry: Any) -> PackedFile:
    _refuse_unknown(entry, ("member", "sha256"), f"fetch: {key}")
    if not isinstance(entry, dict) or set(entry) != {"member", "sha256"}:
        raise ConfigError(f"fetch: {key} is {shown(entry)}, expected member and sha256")
    return PackedFile(str(entry["member"]), str(entry["sha256"]))
