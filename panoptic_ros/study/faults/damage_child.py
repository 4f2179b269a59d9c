"""Child process that tries damaged copies of one format.

`python -m panoptic_ros.study.faults.damage_child FORMAT SEED SECONDS FOLDER` writes one line of JSON per
second, and a last line when the time is over. The address space is limited. A reader that allocates too much
memory raises a MemoryError, which is treated as a foreign exception.
"""

from __future__ import annotations

import itertools
import json
import resource
import sys
import time
from dataclasses import asdict
from pathlib import Path

from panoptic_ros.study.faults.trials import Trials, try_copies

MEMORY = 1 << 30  # bytes that a reader may map beyond the mappings of the process after the first copy


def main() -> int:
    """Try copies until the time is over."""
    name, seed, seconds, folder = sys.argv[1], int(sys.argv[2]), float(sys.argv[3]), Path(sys.argv[4])
    ends = time.monotonic() + seconds
    told, found = 0.0, Trials()
    for number, found in try_copies(name, folder, seed, itertools.count()):
        if number == 0:
            mapped = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
            resource.setrlimit(resource.RLIMIT_AS, (mapped + MEMORY, mapped + MEMORY))
        now = time.monotonic()
        if now >= told + 1.0:
            told = now
            _tell(found)
        if now >= ends:
            break
    _tell(found)
    return 0


def _tell(found: Trials) -> None:
    """Write the state of the trials to the parent process, through standard output."""
    lines = Path("/proc/self/status").read_text().splitlines()  # VmHWM here excludes the peak of the parent
    peak_mb = next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM:"))
    sys.stdout.write(json.dumps({**asdict(found), "peak_mb": peak_mb}) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
