"""What is compiled ahead: parts of the whole, so that several processes can share the work.

`python -m panoptic_ros.running.kernel_tasks` compiles the parts whose names it reads, one a line, and answers
each with a line of the seconds of processor time that it took and the number of kernels compiled.
"""
from __future__ import annotations

import gc
import sys
import time
from collections.abc import Callable
from functools import lru_cache, partial

import numpy as np

from panoptic_ros.association.known_occluders import occluded_depths
from panoptic_ros.domain import Occluders
from panoptic_ros.graph.build import configure, make_stage
from panoptic_ros.kernels import on_compilation
from panoptic_ros.simulation import SKELETON, Ring, Scene, Simulation, simulate
from panoptic_ros.simulation.rendering import Studio
from panoptic_ros.stage import StageContext


def _stage(name: str, **parameters: object) -> None:
    """The constructors of stages compile all that they can need."""
    take = _take()
    make_stage(name, configure({name: parameters})[name], StageContext(take.rig, SKELETON))


def _occluders() -> None:
    """Of a rig that knows what stands between."""
    triangle = Occluders(np.eye(3), np.array([[0, 1, 2]]))
    occluded_depths(_take().rig.cameras[0], triangle)


def _rendering() -> None:
    """Images of simulated people."""
    take = _take()
    next(iter(Studio(take).camera(take.rig.names[0]).render(np.zeros(1))))


@lru_cache(maxsize=1)
def _take() -> Simulation:
    return simulate(Scene("to compile", ("walk",), Ring(2), frames=1), 0, 1)


# the longest first
TASKS: dict[str, Callable[[], None]] = {
    "votes": partial(_stage, "voting"),
    "timecode": partial(_stage, "timecode"),
    "refinement": partial(_stage, "refinement"),
    "offsets": partial(_stage, "offsets", active=True),
    "rendering": _rendering,
    "occluders": _occluders,
    "assembly": partial(_stage, "assembly"),
    "association": partial(_stage, "association"),
    "tracking": partial(_stage, "tracking"),
    "all votes": partial(_stage, "voting", explain_away=False),
    "exact votes": partial(_stage, "voting", method="exact", parts=True),
}


def main() -> None:
    """Compile what is asked for."""
    gc.disable()  # a tenth of the time; what a compiler leaves behind fits into memory
    for line in sys.stdin:
        compiled: list[str] = []
        began = time.process_time()
        with on_compilation(compiled.append):
            TASKS[line.strip()]()
        count = sum(name.startswith("panoptic_ros.") for name in compiled)
        sys.stdout.write(f"{time.process_time() - began} {count}\n")  # to the process that asked
        sys.stdout.flush()


if __name__ == "__main__":
    main()
