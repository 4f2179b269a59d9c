"""Script that measures the time of aniposelib's triangulation; it imports nothing of this project.

It runs in any Python interpreter that has aniposelib: python aniposelib_child.py IN.npz OUT.npz
"""

from __future__ import annotations

import importlib
import sys
import time

import numpy as np


def main(inputs: str, outputs: str) -> None:
    """Triangulate (F, C, N, 2) px frame by frame; the first call is not timed."""
    library = importlib.import_module("aniposelib.cameras")
    rodrigues = importlib.import_module("cv2").Rodrigues
    with np.load(inputs) as given:
        cameras = [
            library.Camera(matrix=k, dist=d, rvec=rodrigues(r)[0].ravel(), tvec=t, name=str(i))
            for i, (k, d, r, t) in enumerate(
                zip(given["matrices"], given["distortions"], given["rotations"], given["translations"])
            )
        ]
        group, frames, budget_s = library.CameraGroup(cameras), given["points"], float(given["budget_s"])
    positions: list[np.ndarray] = []
    wall: list[float] = []
    cpu: list[float] = []
    for number, points in enumerate(frames):
        if cpu and sum(cpu) > 1e3 * budget_s:
            break
        start, start_cpu = time.perf_counter(), time.process_time()
        positions.append(np.asarray(group.triangulate(points)))
        end_cpu, end = time.process_time(), time.perf_counter()
        if number:
            wall.append(1e3 * (end - start))
            cpu.append(1e3 * (end_cpu - start_cpu))
    np.savez(outputs, positions=positions, wall_ms=wall, cpu_ms=cpu)


if __name__ == "__main__":
    main(*sys.argv[1:])
