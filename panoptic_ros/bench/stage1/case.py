"""One case in a process of its own: reads a request as JSON, prints the rows as JSON."""

from __future__ import annotations

import time
from typing import Any

from panoptic_ros.bench.child import answer_request
from panoptic_ros.bench.stage1.any_skeleton import any_skeleton_world, in_joints_of
from panoptic_ros.bench.stage1.baselines import given_rows, greedy_rows
from panoptic_ros.bench.stage1.chain import mapped_rows, people_rows, voting_rows
from panoptic_ros.bench.stage1.rows import Rows
from panoptic_ros.bench.stage1.world import World, make_world

PARTS = ("people", "maps", "voting", "dense", "baselines", "joints")


def measure(request: dict[str, Any]) -> dict[str, Any]:
    """The rows of a case.

    Args:
        request: parts (of PARTS), budget_s; people, views, frames, seed; or bag, cameras, truth; or skeleton.
    """
    parts = set(request["parts"])
    world = _world(request, bool(parts & {"maps", "voting"}))
    rows = Rows(world, request["budget_s"])
    if "people" in parts:
        people_rows(rows)
    if world.mapped and "maps" in parts:
        mapped_rows(rows)
    if world.mapped and "voting" in parts:
        voting_rows(rows, "dense" in parts)
    if "baselines" in parts:
        greedy_rows(rows)
        if world.given:
            given_rows(rows, request.get("aniposelib"))
    people = max((len(frame.ids) for frame in world.truth.frames), default=0) if world.truth else None
    return {
        "people": people,
        "views": len(world.rig),
        "joints": len(world.skeleton),
        "frames": len(world.sets),
        "maps": _grid(world),
        "rows": rows.rows,
        "cpu_s": time.process_time(),
    }


def _world(request: dict[str, Any], maps: bool) -> World:
    if request.get("bag"):
        from panoptic_ros.bench.stage1.recorded import recorded_world

        world = recorded_world(
            request["bag"],
            request.get("cameras"),
            request.get("truth"),
            request["frames"],
            request.get("volume"),
        )
        return in_joints_of(world, request["skeleton"]) if request.get("skeleton") else world
    if request.get("skeleton"):
        return any_skeleton_world(
            request["skeleton"], request["people"], request["views"], request["frames"], request["seed"]
        )
    return make_world(request["people"], request["views"], request["frames"], request["seed"], maps)


def _grid(world: World) -> list[int] | None:
    for item in world.sets:
        for view in item.views:
            if view.maps is not None:
                return list(view.maps.grid_size)
    return None


if __name__ == "__main__":
    answer_request(measure)
