"""Every reader of JSON, YAML and TOML names a key that it does not know, with the nearest known one."""

from __future__ import annotations

import json
import re
import warnings
from collections.abc import Callable, Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest
import yaml

import panoptic_ros
from panoptic_ros.errors import UserError
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.kinematic_files import read_subject
from panoptic_ros.io.known_keys import EACH, OTHERS, UnknownKeyWarning, keys, tell_unknown
from panoptic_ros.study.faults.formats import FORMATS

# Tables whose keys are names that the user or the data choose, by reader: place, as a pattern.
NAMES = {
    "rig of aniposelib": "",
    "rig of caliscope": "|cameras",
    "poses.yaml": "poses",
    "detections.json": r"frames\.views",
    "annotation": "frames",
    "subject.json": "segments|keypoints",
    "parameters": "",
    "skeleton": "joints|mean_of",
    "segments": "segments|keypoints",
    "topics": "",
    "clocks.json": "cameras",
    "bias table": "offsets",
    "joint offsets": "offsets",
    "sound.yaml": "",
    "model card": r"fetch\.mean_outputs|output",
    "synctables": r"kinect\.color|kinect\.depth",
}
# Readers that do not take every key of a table, as other programs write more: only misspelt ones are told.
LOOSE = ("rig of a pack", "annotation", "synctables", "rig of caliscope")
# Readers that say what a file must be where one of its needed keys is not there.
NAMELESS = ("rig.json", "rig of CMU", "rig of a pack", "synctables", "annotation", "preset", "camera_info")
READERS = [name for name in FORMATS if name not in ("metadata.yaml", "metadata.xml")]
SUFFIXES = (".json", ".yaml", ".toml")
# Modules that parse a document for others, or one that this package wrote itself for itself.
OTHER_MODULES = {
    "io.documents": "parses for all others",
    "io.frame_stream": "parses for plain_formats and body_files",
    "io.rigs.document": "parses for registry",
    "running.takes": "hands on what frame_stream reads",
    "io.bag_metadata": "metadata.yaml, which rosbag2 writes",
    "io.motion_files": "an installed table",
    "io.models.tfjs": "a network of TensorFlow.js",
    "io.takes": "marks of takes, of our own",
    "running.viewer.recordings": "report.json of our own",
    "running.runs.result_folder": "the same",
    "running.joint_offsets": "tells bodies from skeletons, which others read",
    "running.runs.over_dds": "launch.json of our own",
    "running.processes.fork_server": "the same",
    "running.kinematics": "a value of --set",
    "nodes.main": "launch.json of our own",
    "view.page.clients": "what a page says",
    "view.page.server": "the same",
    "state.stateful": "states of stages",
}
TELLING = {
    "io.biases",
    "io.body_files",
    "io.body_models",
    "io.board_files",
    "io.clock_files",
    "io.compared_skeletons",
    "io.joint_offsets",
    "io.kinematic_files",
    "io.occluders",
    "io.plain_formats",
    "io.rigs.camera_info",
    "io.rigs.intrinsics",
    "io.skeletons",
    "io.synctables",
}
REFUSING = {
    "capture.sound.folder",
    "io.driver_topics",
    "io.models.cards",
    "running.plans.parameters",
    "running.plans.presets",
}


def told(read: Callable[[Path], object], path: Path) -> list[str]:
    """The lines that a reader says of a file, warnings or an error."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            read(path)
        except UserError as error:
            return [str(error)]
    return [str(item.message) for item in caught if issubclass(item.category, UnknownKeyWarning)]


def tables(value: Any, place: str = "") -> Iterator[tuple[str, dict[Any, Any]]]:
    """Every table of a document with its place; the entries of a list share one."""
    if isinstance(value, list):
        for entry in value:
            yield from tables(entry, place)
    elif isinstance(value, dict):
        yield place, value
        for key, inner in value.items():
            yield from tables(inner, f"{place}.{key}" if place else str(key))


def shortened(name: str, place: str) -> str:
    """The place without names that somebody chose."""
    pattern, parts = NAMES.get(name, "(?!)"), list[str]()
    for part in place.split(".") if place else ():
        if not re.fullmatch(pattern, ".".join(parts)):
            parts.append(part)
        elif not parts or parts[-1] != EACH:
            parts.append(EACH)
    return ".".join(parts)


def document_of(path: Path) -> Any:
    return json.loads(path.read_text()) if path.suffix == ".json" else yaml.safe_load(path.read_text())


def write(path: Path, document: Any) -> None:
    is_json = path.suffix == ".json"
    path.write_text(json.dumps(document) if is_json else yaml.safe_dump(document, sort_keys=False))


@pytest.fixture(params=READERS)
def sample(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[str, Path]:
    name: str = request.param
    path = FORMATS[name].sample(tmp_path)
    if path.suffix not in SUFFIXES:
        pytest.skip("no JSON, YAML or TOML")
    return name, path


def test_a_good_file_is_read_without_a_word(sample: tuple[str, Path]) -> None:
    name, path = sample
    assert told(FORMATS[name].read, path) == []


def test_a_misspelt_key_anywhere_is_named_with_the_nearest(sample: tuple[str, Path]) -> None:
    name, path = sample
    if path.suffix == ".toml":
        _test_toml(name, path)
        return
    whole, seen = document_of(path), set[tuple[str, str]]()
    for at, (place, table) in enumerate(tables(whole)):
        if re.fullmatch(NAMES.get(name, "(?!)"), shortened(name, place)):
            continue
        for key in table:
            if (shortened(name, place), str(key)) in seen:
                continue
            seen.add((shortened(name, place), str(key)))
            document = deepcopy(whole)
            changed = list(tables(document))[at][1]
            changed[f"{key}q"] = changed[key]
            if name not in LOOSE:
                write(path, document)
                lines = told(FORMATS[name].read, path)
                named = any(f"{key}q" in line and str(key) in line.replace(f"{key}q", "") for line in lines)
                assert named, (place, key, lines)
            del changed[key]
            write(path, document)
            lines = told(FORMATS[name].read, path)
            nameless = key == "format" or name in NAMELESS
            assert any(str(key) in line or nameless for line in lines), (place, key, lines)
    assert seen


def _test_toml(name: str, path: Path) -> None:
    lines = path.read_text().splitlines()
    tested = 0
    for k, line in enumerate(lines):
        key, equals, _ = line.partition(" = ")
        if equals and line:
            path.write_text("\n".join([*lines[:k], f"{key}q = 1", *lines[k:]]) + "\n")
            said = told(FORMATS[name].read, path)
            in_notes = "[metadata]" in lines[:k]
            assert in_notes or any(f"{key}q" in text and key in text for text in said), (line, said)
            tested += 1
    assert tested > 5


def test_every_module_that_parses_documents_is_known_here() -> None:
    root = Path(panoptic_ros.__file__).parent
    pattern = re.compile(r"\b(read_json|read_yaml|read_frames|parse_json|parse_toml|json\.loads)\b(?=\(|\))")
    found = {
        ".".join(path.relative_to(root).with_suffix("").parts)
        for path in root.rglob("*.py")
        if pattern.search(path.read_text())
    }
    found = {name for name in found if not name.startswith("study.")}
    assert found == {*OTHER_MODULES, *TELLING, *REFUSING}
    for name in TELLING:
        assert "tell_unknown(" in root.joinpath(*name.split(".")).with_suffix(".py").read_text(), name


def test_facing_beside_the_t_pose_is_told_to_belong_into_it(tmp_path: Path) -> None:
    path = FORMATS["subject.json"].sample(tmp_path)
    document = document_of(path)
    document["facing"] = document["t_pose"].pop("facing")
    write(path, document)
    (line,) = told(lambda file: read_subject(file, read_body_model()), path)
    assert line == f"{path}: the key 'facing' is not known and not used; it belongs in t_pose"


KNOWN = keys(
    "name size", parts=[keys("offset mount")], by_name={EACH: keys("start end")}, notes=keys(f"date {OTHERS}")
)


@pytest.mark.parametrize(
    ("document", "lines"),
    [
        ({"name": 1, "parts": [{"offset": 1}], "by_name": {"x": {"start": 1}}, "notes": {"who": 1}}, []),
        ({"Name": 1}, ["the key 'Name' is not known and not used; the nearest known one is 'name'"]),
        (
            {"zzz": 1},
            ["the key 'zzz' is not known and not used; known are name, size, parts, by_name, notes"],
        ),
        (
            {"parts": [{"ofset": 1}] * 3},
            ["parts: the key 'ofset' (3 times) is not known and not used; the nearest known one is 'offset'"],
        ),
        ({"mount": 1}, ["the key 'mount' is not known and not used; it belongs in parts"]),
        (
            {"by_name": {"x": {"ends": 1}}},
            ["by_name.*: the key 'ends' is not known and not used; the nearest known one is 'end'"],
        ),
        (
            {"notes": {"dates": 1}},
            ["notes: the key 'dates' is not known and not used; the nearest known one is 'date'"],
        ),
        ({"notes": {"dates": 1, "date": 2}}, []),
        ({"parts": 5, "by_name": [1], "notes": None}, []),
        ([1, 2], []),
        ("text", []),
    ],
)
def test_what_is_told(document: Any, lines: list[str]) -> None:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        tell_unknown(document, KNOWN, "f")
    assert [str(item.message) for item in caught] == [f"f: {line}" for line in lines]


def test_many_unknown_keys_are_told_in_few_lines() -> None:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        tell_unknown({f"k{k}": 1 for k in range(20)}, KNOWN, "f")
    assert len(caught) == 6 and str(caught[-1].message) == "f: 15 more keys are not known and not used"
