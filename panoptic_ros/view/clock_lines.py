"""Clocks that were found from motion, in words."""

from __future__ import annotations

from panoptic_ros.offsets import CameraClocks


def clock_lines(clocks: CameraClocks) -> list[str]:
    """What was found, in words."""
    width = max(len(name) for name in clocks.cameras)
    lines = ["clocks from motion (to be added to the stamps):"]
    for c, name in enumerate(clocks.cameras):
        offset, deviation = 1e3 * clocks.offsets[c], 1e3 * clocks.deviations[c]
        drift, wobble = 1e6 * clocks.drifts[c], 1e6 * clocks.drift_deviations[c]
        if not clocks.known[c]:
            text = f"not known (within {deviation:.0f} ms at best): too little moves in its view; stamps kept"
        elif clocks.applied[c]:
            text = f"{offset:+8.2f} ms +- {deviation:.2f}   drift {drift:+4.0f} ppm +- {wobble:.0f}"
        else:
            text = f"{offset:+8.2f} ms +- {deviation:.2f}   no more than chance; stamps kept"
        lines.append(f"  {name:<{width}}  {text}")
    for name, far in zip(clocks.cameras, clocks.strays):
        if far > 0.0:
            lines.append(f"  {name} strays from this by up to {1e3 * far:.0f} ms: does its clock jump?")
    if not clocks.known.any():
        lines.append("  nothing moves enough to compare the clocks; let somebody walk about for 5 s")
    if clocks.bias > 0.0:
        bias = f"{1e3 * clocks.bias:.0f} mm"
        lines.append(f"  2D joints are {bias} off for seconds on end; the deviations allow for it")
    if not clocks.converged:
        lines.append(f"  the estimate still moved after {clocks.iterations} iterations; trust it less")
    return lines
