"""Status of live graphs, as text lines for a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from panoptic_ros.graph.health import ReceivedStatus

PERIOD_S = 1.0  # s between status messages of a node
STALE_S = 2.5  # s without a status message after which a node is treated as silent
STAGES = ("stage", "node", "state", "/s", "age s", "step ms p50", "p99", "latency ms p50", "p99", "dropped")
INPUTS = ("input", "of", "/s", "age s", "latency ms p50", "p99", "lost", "left out", "bad")


def watch_lines(told: Sequence[ReceivedStatus], now_s: float) -> list[str]:
    """Return text lines for each graph: its warnings, its stages, its inputs."""
    lines: list[str] = []
    for namespace in sorted({item.namespace for item in told}):
        own = [item for item in told if item.namespace == namespace]
        lines += [*([""] if lines else []), *_graph_lines(namespace, own, now_s)]
    return lines


def _graph_lines(namespace: str, told: Sequence[ReceivedStatus], now_s: float) -> list[str]:
    warned = [item for item in told if item.trouble and item.name != "graph"]
    gone = sorted(
        {item.values["node"] for item in told if "node" in item.values and now_s - item.heard_s > STALE_S}
    )
    nodes = {item.values["node"] for item in told if "node" in item.values}
    count = len(warned) + len(gone)
    how = "all is well" if not count else "1 warning" if count == 1 else f"{count} warnings"
    if not nodes:
        return [f"graph /{namespace}: no stage has reported yet, or its run is over"]
    lines = [f"graph /{namespace}: {len(nodes)} node{'s' * (len(nodes) != 1)}, {how}"]
    lines += [f"  WARN  no message from node {name} for {STALE_S:g} s or more" for name in gone]
    lines += [f"  WARN  {item.name}: {item.trouble}" for item in warned]
    stages = [_stage_row(item, now_s) for item in told if "state" in item.values]
    inputs = [_input_row(item, now_s) for item in told if "rate_hz" in item.values and "topic" in item.values]
    return [*lines, "", *_columns(STAGES, stages), "", *_columns(INPUTS, inputs)]


def _stage_row(item: ReceivedStatus, now_s: float) -> list[str]:
    values = item.values
    dropped = [
        f"{key.removeprefix('dropped.')} {count}"
        for key, count in values.items()
        if key.startswith("dropped.")
    ]
    return [
        item.name,
        values["node"],
        values["state"],
        *_numbers(values, "rate_hz"),
        _age(item, now_s),
        *_numbers(values, "step_p50_ms", "step_p99_ms", "latency_p50_ms", "latency_p99_ms"),
        ", ".join(dropped) or "-",
    ]


def _input_row(item: ReceivedStatus, now_s: float) -> list[str]:
    values = item.values
    return [
        item.name.partition(": ")[2],
        values["node"],
        *_numbers(values, "rate_hz"),
        _age(item, now_s),
        *_numbers(values, "latency_p50_ms", "latency_p99_ms"),
        values["lost"],
        values["left_out"],
        values["bad"],
    ]


def _numbers(values: Mapping[str, str], *keys: str) -> list[str]:
    found = (float(values.get(key, "nan")) for key in keys)
    return ["-" if number != number else f"{number:.1f}" for number in found]


def _age(item: ReceivedStatus, now_s: float) -> str:
    """Return the age (s) of the newest message: the age in the status plus the delay of an overdue status."""
    age = float(item.values["age_s"]) + max(0.0, now_s - item.heard_s - PERIOD_S)
    return "-" if age != age else f"{age:.1f}"


def _columns(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Return aligned text columns, names on the left and numbers on the right; empty without rows."""
    if not rows:
        return []
    widths = [max(len(row[k]) for row in (titles, *rows)) for k in range(len(titles))]
    left = [titles[k] in ("stage", "node", "state", "input", "of", "dropped") for k in range(len(titles))]
    return [
        "  ".join(
            cell.ljust(width) if to_left else cell.rjust(width)
            for cell, width, to_left in zip(row, widths, left)
        ).rstrip()
        for row in (titles, *rows)
    ]
