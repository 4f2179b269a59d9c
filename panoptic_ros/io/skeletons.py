"""Read skeleton models from config/skeletons/*.yaml, and map a detector's joints to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from panoptic_ros.domain import JointMap, SkeletonModel
from panoptic_ros.errors import ConfigError, DataError, shown
from panoptic_ros.io.documents import read_yaml
from panoptic_ros.io.known_keys import keys, tell_unknown
from panoptic_ros.io.loading import parsing
from panoptic_ros.io.resources import share_folder

DEFAULT_SKELETON = "panoptic19"
KEYS = keys("name root head joints bones left_right mean_of")


def skeleton_names() -> tuple[str, ...]:
    """Return the names of the installed skeleton models."""
    return tuple(sorted(path.stem for path in (share_folder() / "config" / "skeletons").glob("*.yaml")))


def load_skeleton(name_or_path: str) -> SkeletonModel:
    """Read a skeleton model by its name, or from a YAML file.

    Raises:
        ConfigError: if the name is unknown or the file is not a skeleton.
    """
    return _model(_document(name_or_path))


def shared_names(name_or_path: str) -> tuple[str, ...]:
    """Return the joint names of a skeleton in the vocabulary that all skeletons share.

    Raises:
        ConfigError: see `load_skeleton`.
    """
    return tuple(_document(name_or_path)["joints"].values())


def map_joints(skeleton: str, detector_joints: Sequence[str]) -> tuple[SkeletonModel, JointMap]:
    """Return the working skeleton for a detector, and the map from the detector's joints to its joints.

    Joints match if their names in the shared vocabulary are equal. A detector's joint names come from the
    vocabulary or from any installed skeleton (lShoulder, left_shoulder, ...). A joint that the detector lacks
    is `derived` if the skeleton defines it as a mean of detected joints; otherwise it is never measured.

    Raises:
        ConfigError: if no joint of the skeleton can be derived from the detector's joints.
    """
    document = _document(skeleton)
    model = _model(document)
    vocabulary = _vocabulary()
    known = {vocabulary.get(joint, joint): i for i, joint in enumerate(detector_joints)}
    sources: list[tuple[int, ...]] = []
    derived: list[tuple[int, tuple[int, ...]]] = []
    for i, (joint, word) in enumerate(document["joints"].items()):
        parts = [document["joints"][name] for name in document["mean_of"].get(joint, [])]
        if word in known:
            sources.append((known[word],))
        elif parts and all(part in known for part in parts):
            sources.append(tuple(known[part] for part in parts))
            derived.append((i, tuple(model.joint(name) for name in document["mean_of"][joint])))
        else:
            sources.append(())
    if not any(sources):
        raise ConfigError(
            f"skeleton {model.name} has none of the joints {', '.join(list(detector_joints)[:5])}, ..."
        )
    return replace(model, derived=tuple(derived)), JointMap(len(detector_joints), tuple(sources))


def skeleton_of(joint_names: Sequence[str]) -> str | None:
    """Return the name of the installed skeleton with exactly these joints, in any order and spelling.

    None if there is none.
    """
    vocabulary = _vocabulary()
    words = {vocabulary.get(joint, joint) for joint in joint_names}
    for name in skeleton_names():
        if set(_document(name)["joints"].values()) == words:
            return name
    return None


def fullest_skeleton(joint_names: Sequence[str]) -> str | None:
    """Return the installed skeleton that these joints fill completely and that uses most of them.

    On a tie the default is preferred. None if no skeleton is filled.
    """
    best, most = None, 0
    for name in sorted(skeleton_names(), key=lambda name: name != DEFAULT_SKELETON):
        try:
            sources = map_joints(name, joint_names)[1].sources
        except ConfigError:  # no joint in common
            continue
        used = len({k for source in sources for k in source})
        if all(sources) and used > most:
            best, most = name, used
    return best


def in_vocabulary(joint_names: Sequence[str]) -> tuple[str, ...]:
    """Return joint names in the vocabulary that all skeletons share; unknown names unchanged."""
    vocabulary = _vocabulary()
    return tuple(vocabulary.get(joint, joint) for joint in joint_names)


@lru_cache(maxsize=32)
def _document(name_or_path: str) -> dict[str, Any]:
    path = Path(name_or_path)
    if path.suffix not in (".yaml", ".yml"):
        path = share_folder() / "config" / "skeletons" / f"{name_or_path}.yaml"
        if name_or_path not in skeleton_names():
            raise ConfigError(
                f"unknown skeleton {shown(name_or_path)}; there are {', '.join(skeleton_names())}, "
                "or the path of a YAML file"
            )
    document = read_yaml(path)
    with parsing(path):
        return _checked(document, path)


def _checked(document: Any, path: Path) -> dict[str, Any]:
    """Return the document with default values for missing keys, after checking that it is a skeleton.

    Raises:
        DataError: if it is none.
    """
    wanted = {"name": str, "root": str, "head": str, "joints": dict, "bones": list}
    for key, kind in wanted.items():
        if not isinstance(document, dict) or not isinstance(document.get(key), kind):
            raise DataError(f"{path} is not a skeleton model: it needs a {kind.__name__} {shown(key)}")
    tell_unknown(document, KEYS, path)
    whole: dict[str, Any] = {"left_right": [], "mean_of": {}, **document}
    _check(whole, path)
    return whole


def _check(document: dict[str, Any], path: Path) -> None:
    """Check that bones, left-right pairs and means name joints of the file.

    Raises:
        DataError: if they do not, or have another structure.
    """
    for joint, word in document["joints"].items():
        if not isinstance(joint, str) or not isinstance(word, str):
            raise DataError(f"{path}: joints must map names to names, found {shown(joint)}: {shown(word)}")
    if not isinstance(document["left_right"], list):
        raise DataError(f"{path}: left_right is {shown(document['left_right'])}, expected a list of pairs")
    means = document["mean_of"]
    if not isinstance(means, dict) or not all(isinstance(parts, list) and parts for parts in means.values()):
        raise DataError(f"{path}: mean_of must map joints to lists of joints")
    for key in ("bones", "left_right"):
        for row in document[key]:
            if not isinstance(row, list) or len(row) != 2:
                raise DataError(f"{path}: an entry of {key} is not a list of two joints: {shown(row)}")
    named = [("mean_of", [joint, *parts]) for joint, parts in means.items()]
    named += [(key, row) for key in ("bones", "left_right") for row in document[key]]
    for key, row in named:
        for joint in row:
            if joint not in document["joints"]:
                raise DataError(f"{path}: {key} names {shown(joint)}, which is none of the joints")


def _model(document: dict[str, Any]) -> SkeletonModel:
    names = tuple(document["joints"])

    def at(joint: str) -> int:
        if joint not in names:
            raise ConfigError(f"skeleton {document['name']}: {shown(joint)} is none of its joints")
        return names.index(joint)

    def pairs(key: str) -> tuple[tuple[int, int], ...]:
        return tuple((at(a), at(b)) for a, b in document[key])

    return SkeletonModel(
        document["name"],
        names,
        at(document["root"]),
        pairs("bones"),
        at(document["head"]),
        pairs("left_right"),
    )


@lru_cache(maxsize=1)
def _vocabulary() -> dict[str, str]:
    """Return the map from the joint names of all installed skeletons to the shared vocabulary."""
    words: dict[str, str] = {}
    for name in skeleton_names():
        words.update(_document(name)["joints"])
    return words
