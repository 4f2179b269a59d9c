"""From the figures of all samples to what each mechanism changes, in each scene and in all together."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from panoptic_ros.bench.ablation.differences import Difference, over_scenes, paired
from panoptic_ros.bench.ablation.figures import FIGURES

DEFAULT = ""  # in place of a mechanism's name: none was off
EVERYTHING = "all scenes"
Samples = list[dict[str, float]]  # figures by their keys, of every seed or stretch


def summary(samples: Mapping[str, Mapping[str, Samples]], names: Sequence[str]) -> list[dict[str, Any]]:
    """For all scenes together and for each: what the default reaches, and what each mechanism changes.

    Args:
        samples: {scene: {mechanism that was off: figures of every sample}}; `DEFAULT` = none was.
    """
    differences = {
        scene: {name: _differences(runs[name], runs[DEFAULT]) for name in names if name in runs}
        for scene, runs in samples.items()
    }
    means = {scene: _means(runs[DEFAULT]) for scene, runs in samples.items()}
    everywhere = {
        name: {
            figure.key: over_scenes([own[name][figure.key] for own in differences.values() if name in own])
            for figure in FIGURES
        }
        for name in names
    }
    blocks = [(EVERYTHING, _means(list(means.values())), len(samples), everywhere)]
    blocks += [(scene, means[scene], len(samples[scene][DEFAULT]), own) for scene, own in differences.items()]
    return [
        {
            "scene": scene,
            "samples": count,
            "default": {key: _number(value) for key, value in mean.items()},
            "off": {
                name: {key: _row(found) for key, found in figures.items()} for name, figures in own.items()
            },
        }
        for scene, mean, count, own in blocks
    ]


def _differences(off: Samples, default: Samples) -> dict[str, Difference]:
    return {
        figure.key: paired([row[figure.key] for row in off], [row[figure.key] for row in default])
        for figure in FIGURES
    }


def _means(rows: Sequence[dict[str, float]]) -> dict[str, float]:
    return {figure.key: _mean(row[figure.key] for row in rows) for figure in FIGURES}


def _mean(values: Iterable[float]) -> float:
    known = [value for value in values if math.isfinite(value)]
    return sum(known) / len(known) if known else math.nan


def _row(found: Difference) -> dict[str, Any]:
    return {"mean": _number(found.mean), "error": _number(found.error), "clear": found.clear}


def _number(value: float) -> float | None:
    """For JSON, which knows no NaN."""
    return value if math.isfinite(value) else None
