"""The result of the bench `ablation` as a table for people."""

from __future__ import annotations

from typing import Any

from panoptic_ros.bench.ablation.figures import FIGURES, Figure

CELL = 19
NAMES = 22
LEGEND = (
    "Change of each figure when a mechanism is off, with its standard error; * = more than chance (95 %).",
    "Misfit: by how many points the share of joints within their 95 % ellipsoids is not 95.",
    "Errors are over seeds, or over stretches of a recording; `all scenes` gives each scene the same weight.",
)


def lines(result: dict[str, Any]) -> list[str]:
    """All scenes together; each scene with the mechanisms that change anything there; what earns nothing."""
    everything, *scenes = result["scenes"]
    seeds = result["seeds"]
    out = [*LEGEND, f"Seeds {seeds[0]} to {seeds[-1]}.", "", *_block(everything, result["mechanisms"], True)]
    for scene in scenes:
        out += ["", *_block(scene, result["mechanisms"], False)]
    idle = [m["name"] for m in result["mechanisms"] if earns_nothing(m["name"], result["scenes"])]
    out += ["", "No figure is clearly worse anywhere without: " + (", ".join(idle) or "(none of them)")]
    width = max(len(m["name"]) for m in result["mechanisms"]) + 2
    return [*out, "", *(f"{m['name']:<{width}}{m['part']}: {m['about']}" for m in result["mechanisms"])]


def earns_nothing(name: str, scenes: list[dict[str, Any]]) -> bool:
    """Whether no figure of quality is clearly worse in any scene, or in all together, when it is off."""
    return not any(
        _is_worse(scene["off"][name][figure.key], figure)
        for scene in scenes
        if name in scene["off"]
        for figure in FIGURES
    )


def _is_worse(change: dict[str, Any], figure: Figure) -> bool:
    return bool(change["clear"] and change["mean"] * figure.worse > 0.0)


def _block(scene: dict[str, Any], mechanisms: list[dict[str, Any]], whole: bool) -> list[str]:
    heads = "".join(f"{figure.title:>{CELL}}" for figure in FIGURES)
    default = "".join(f"{_plain(scene['default'][f.key], f):>{CELL}}" for f in FIGURES)
    out = [f"{scene['scene']} ({scene['samples']})", f"  {'':<{NAMES}}{heads}"]
    out.append(f"  {'default':<{NAMES}}{default}")
    for mechanism in mechanisms:
        changes = scene["off"].get(mechanism["name"])
        if changes and (whole or _changes_anything(changes)):
            cells = "".join(f"{_cell(changes[figure.key], figure):>{CELL}}" for figure in FIGURES)
            out.append(f"  {mechanism['name']:<{NAMES}}{cells}")
    return out


def _changes_anything(changes: dict[str, Any]) -> bool:
    return any(changes[figure.key]["mean"] for figure in FIGURES if figure.worse)


def _plain(value: float | None, figure: Figure) -> str:
    return "-" if value is None else f"{value:.{figure.digits}f} "


def _cell(change: dict[str, Any], figure: Figure) -> str:
    if change["mean"] is None:
        return "- "
    error = "" if change["error"] is None else f" ±{change['error']:.{figure.digits}f}"
    return f"{change['mean']:+.{figure.digits}f}{error}{'*' if change['clear'] else ' '}"
