"""One case in a process of its own: solves it by default and with each mechanism off, prints the figures."""

from __future__ import annotations

from typing import Any

from panoptic_ros.bench.ablation.figures import figures_of, solve
from panoptic_ros.bench.ablation.mechanisms import chosen
from panoptic_ros.bench.ablation.summary import DEFAULT
from panoptic_ros.bench.ablation.worlds import Case, recorded_case, simulated_case
from panoptic_ros.bench.child import answer_request


def measure(request: dict[str, Any]) -> dict[str, Any]:
    """The figures of every run by the name of the mechanism that was off; `DEFAULT` = none was.

    Args:
        request: only: names of mechanisms; scene, seed, frames, model; or paths, of a recording.
    """
    case = _case(request)
    _figures(case, {})  # what runs first runs in cold caches
    runs = {DEFAULT: _figures(case, {})}
    for mechanism in chosen(request["only"]):
        if case.world.mapped or not mechanism.maps:
            runs[mechanism.name] = _figures(case, mechanism.off)
    return {"frames": len(case.world.sets), "views": len(case.world.rig), "runs": runs}


def _case(request: dict[str, Any]) -> Case:
    if "paths" in request:
        return recorded_case(request["paths"])
    return simulated_case(request["scene"], request["seed"], request["frames"], request["model"])


def _figures(case: Case, settings: dict[str, dict[str, Any]]) -> list[dict[str, float]]:
    assert case.world.truth is not None  # all cases have one
    return figures_of(case.world.truth, solve(case.world, settings, case.names), case.stretches)


if __name__ == "__main__":
    answer_request(measure)
