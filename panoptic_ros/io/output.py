"""Where a process prints."""
from __future__ import annotations

import os
from pathlib import Path


def print_to(path: Path | str) -> None:
    """Let this process print to the end of a file, and read nothing."""
    output = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o666)
    for number, descriptor in ((0, os.open(os.devnull, os.O_RDONLY)), (1, output), (2, output)):
        os.dup2(descriptor, number)
