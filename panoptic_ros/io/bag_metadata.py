"""Read metadata.yaml of a bag: its files, and the message counts, hashes and QoS of its topics."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path, PurePath
from typing import Any, NamedTuple

from panoptic_ros.errors import DataError
from panoptic_ros.io.documents import read_yaml
from panoptic_ros.io.loading import MIB, parsing
from panoptic_ros.io.storages import is_storage, packed_name

NAME = "metadata.yaml"
# Limits of the file: bytes and number of YAML values. A recording of 480 cameras with eight topics each has 2
# MB and 100 000 values.
LARGEST_METADATA, MOST_VALUES = 16 * MIB, 1_000_000


class BagMetadata(NamedTuple):
    """Contents of metadata.yaml.

    Args:
        files: file names in the order of recording.
        counts: number of messages by topic.
        digests: RIHS01 hash by topic.
        qualities: QoS profiles by topic, see `bag_connections.qualities_in`.
    """

    files: tuple[str, ...] = ()
    counts: Mapping[str, int] = {}
    digests: Mapping[str, str] = {}
    qualities: Mapping[str, Any] = {}


class BagFiles(NamedTuple):
    """Existing files of a bag, and one warning line for each group of missing or unlisted files."""

    paths: tuple[Path, ...]
    problems: tuple[str, ...]


def read_metadata(folder: Path) -> BagMetadata:
    """Read metadata.yaml of a folder.

    Raises:
        DataError: with a one-line message, if the file is missing or cannot be read.
    """
    path = folder / NAME
    if not path.is_file():
        raise DataError(f"it has no {NAME}")
    document = read_yaml(path, LARGEST_METADATA, MOST_VALUES)
    with parsing(path):
        told = document["rosbag2_bagfile_information"]
        counts: Counter[str] = Counter()
        digests: dict[str, str] = {}
        qualities: dict[str, Any] = {}
        for row in told["topics_with_message_count"]:
            about: Any = row["topic_metadata"]
            topic = str(about["name"])
            counts[topic] += int(row["message_count"])
            digests[topic] = str(about.get("type_description_hash") or "")
            qualities[topic] = about.get("offered_qos_profiles")
        names = tuple(PurePath(str(name)).name for name in told["relative_file_paths"])
    return BagMetadata(names, counts, digests, qualities)


def files_in(folder: Path) -> list[Path]:
    """Return the bag files in a folder; a compressed file only if its uncompressed version is missing."""
    found = sorted(path for path in folder.iterdir() if is_storage(path) and path.is_file())
    names = {path.name for path in found}
    return [path for path in found if packed_name(path) == path.name or packed_name(path) not in names]


def chosen_files(folder: Path, metadata: BagMetadata) -> BagFiles:
    """Return the existing files that the metadata list, compressed or not.

    If none of the listed files exists, return all bag files of the folder.

    Raises:
        DataError: if the folder has no bag file.
    """
    there = {packed_name(path): path for path in files_in(folder)}
    wanted = [packed_name(Path(name)) for name in metadata.files]
    named = [there[name] for name in wanted if name in there]
    missing = [name for name in wanted if name not in there]
    others = [path.name for name, path in there.items() if name not in wanted]
    if not there:
        raise DataError(f"the files that {NAME} names do not exist: {_list(missing) or 'it names none'}")
    if not named:
        told = f"{NAME} names {_list(missing) or 'no file'}, which does not exist; {_list(others)} is read"
        return BagFiles(tuple(there.values()), (told,))
    problems = [f"{_list(missing)} is missing, which {NAME} names"] if missing else []
    if others:
        told = f"{_list(others)} is not read, as {NAME} does not name it"
        problems.append(f"{told}; `panoptic bag repair` reads it")
    return BagFiles(tuple(named), tuple(problems))


def count_difference(stated: Mapping[str, int], there: Mapping[str, int]) -> str:
    """Return a line about topics whose message count differs from the metadata; "" if all agree.

    Args:
        stated: number of messages by topic, from the metadata.
        there: number of messages by topic, as counted in the files.
    """
    odd = [topic for topic in stated if stated[topic] != there.get(topic, 0)]
    if not odd:
        return ""
    told = [f"{topic} {there.get(topic, 0)} of {stated[topic]}" for topic in odd]
    return f"{NAME} counts {sum(stated.values())} messages, there are {sum(there.values())}: {_list(told)}"


def _list(words: list[str], most: int = 3) -> str:
    """Join the first `most` words with commas and append the number of the others."""
    more = f" and {len(words) - most} more" if len(words) > most else ""
    return ", ".join(words[:most]) + more
