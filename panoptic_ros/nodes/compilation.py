"""Telling in the log that a node has to compile kernels before it can take data."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from panoptic_ros.kernels import on_compilation

TEXT = (
    "kernels are not compiled yet: the node takes data in about half a minute, once per installation; "
    "`panoptic warm-up` does it ahead"
)


@contextmanager
def compilation_told(logger: Any) -> Iterator[None]:
    """While this holds, say once that something is being compiled."""
    told: list[str] = []

    def tell(kernel: str) -> None:
        if kernel.startswith("panoptic_ros.") and not told:
            told.append(kernel)
            logger.warning(TEXT)

    with on_compilation(tell):
        yield
