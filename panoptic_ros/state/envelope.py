"""The bytes round a state: what they are, whom they are for, and whether they are whole.

Mark (8 bytes), version, length of the text and of all (unsigned, little-endian), BLAKE2b of what follows;
then a JSON text, and the arrays one after another, each at a multiple of 16 from the end of the text.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from hashlib import blake2b
from typing import Any

import numpy as np

from panoptic_ros.errors import DataError
from panoptic_ros.state.layout import StateLayout

MARK = b"PANSTATE"
VERSION = 1
ALIGNMENT = 16
FIXED = struct.Struct("<8sIQQ16s")


def closed(
    layout: StateLayout, conditions: Mapping[str, str], tree: Any, arrays: Sequence[np.ndarray]
) -> bytes:
    """The state of a stage as bytes, from its tree (see `writing`) and its arrays."""
    head = {"stage": layout.stage, "layout": layout.schema, "same": dict(conditions), "tree": tree}
    text = json.dumps(head, allow_nan=False, separators=(",", ":")).encode()
    parts = [text]
    for array in arrays:
        parts += [array.tobytes(), bytes(-array.nbytes % ALIGNMENT)]
    body = b"".join(parts)
    fixed = FIXED.pack(MARK, VERSION, len(text), FIXED.size + len(body), _digest(body))
    return fixed + body


def opened(layout: StateLayout, conditions: Mapping[str, str], state: bytes) -> tuple[Any, memoryview]:
    """The tree and the bytes of the arrays.

    Raises:
        DataError: if they are not a whole state of this kind of stage.
    """
    what = f"the state to begin {layout.stage} from"
    if len(state) < FIXED.size or state[: len(MARK)] != MARK:
        raise DataError(f"{what} is not the state of a stage: give the bytes that {layout.stage} handed over")
    _, version, text_length, length, digest = FIXED.unpack_from(state)
    if version != VERSION:
        raise DataError(f"{what} is of format {version}, this version has {VERSION}; hand it over anew")
    body = memoryview(state)[FIXED.size :]
    if len(state) != length or digest != _digest(body):
        raise DataError(
            f"{what} is damaged: {len(state)} of {length} bytes, wrong checksum; hand it over anew"
        )
    try:
        head = json.loads(bytes(body[:text_length]))
        _check(layout, conditions, head, what)
        return head["tree"], body[text_length:]
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise DataError(f"{what} has no readable head: {error!r}; hand it over anew") from None


def _check(layout: StateLayout, conditions: Mapping[str, str], head: Mapping[str, Any], what: str) -> None:
    if head["stage"] != layout.stage:
        raise DataError(f"{what} is one of {head['stage']}; give the bytes that {layout.stage} handed over")
    if head["layout"] != layout.schema:
        raise DataError(f"{what} was handed over by another version of the stage; hand it over anew")
    other = [name for name, value in conditions.items() if head["same"][name] != value]
    if other:
        raise DataError(f"{what} is of a stage whose {' and '.join(other)} differ; begin with the same")


def _digest(body: bytes | memoryview) -> bytes:
    return blake2b(body, digest_size=16).digest()
