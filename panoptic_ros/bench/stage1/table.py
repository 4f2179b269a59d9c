"""The result of the bench `stage1` as tables for people."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

Row = dict[str, Any]
WIDTH = 54  # of the names of methods
CELL = 20


def lines(result: dict[str, Any]) -> list[str]:
    """Times, accuracy, growth and memory."""
    cases = result["cases"]
    out = [
        "Processor time in ms per instant, one thread, first call excluded: median / 99th percentile, ratio.",
        "MPJPE in mm, person recall, person precision: on the same simulated 2D people.",
    ]
    people = sorted({c["request"]["people"] for c in cases if c["request"]["kind"] == "grid"})
    for count in people:
        mine = [c for c in cases if c["request"]["kind"] == "grid" and c["request"]["people"] == count]
        heads = [f"{c['request']['views']} views" for c in mine]
        out += _block(f"{count} {'person' if count == 1 else 'people'}", mine, heads)
    for kind, title in (("many", "Many views"), ("joints", "Joints"), ("bag", "Recorded")):
        mine = [c for c in cases if c["request"]["kind"] == kind]
        if mine:
            out += _block(title, mine, [_head(c) for c in mine])
    spent = sum(case["cpu_s"] for case in cases)
    return [*out, *_growth(result["growth"]), "", f"{spent:.0f} s of processor time in all"]


def _head(case: dict[str, Any]) -> str:
    return f"{case['joints']} joints" if case["request"]["kind"] == "joints" else f"{case['views']} views"


def _block(title: str, cases: list[dict[str, Any]], heads: list[str]) -> list[str]:
    maps = {"x".join(map(str, case["maps"])) for case in cases if case["maps"]}
    names: list[tuple[str, str]] = []
    for case in cases:
        names += [key for row in case["rows"] if (key := (row["step"], row["method"])) not in names]
    out = ["", f"{title} (maps {', '.join(sorted(maps))})" if maps else title]
    out += ["", _line("time, ms", heads), _line("", ["-" * (CELL - 2)] * len(heads))]
    notes = []
    for name in names:
        rows = [_row(case, name) for case in cases]
        out.append(_line(": ".join(name), [_cell(row, _times) for row in rows]))
        notes += [f"{name[1]}: {r['note']}" for r in rows if r and r["note"]]
    out += [f"  * {note}" for note in dict.fromkeys(notes)]
    scored = [n for n in names if any((_row(c, n) or {}).get("mpjpe_mm") is not None for c in cases)]
    if scored:
        out += ["", _line("accuracy: MPJPE, recall, precision", heads)]
        out += [_line(": ".join(n), [_cell(_row(c, n), _quality) for c in cases]) for n in scored]
    checks = [r["equal_to_exact"] for c in cases for r in c["rows"] if "equal_to_exact" in r]
    if checks:
        out.append(f"exact voting gives what dense voting gives: {'yes' if all(checks) else 'NO'}")
    out += ["", _line("memory: growth while it ran, MB", heads)]
    for name in names:
        cells = [_cell(_row(c, name), _memory) for c in cases]
        if any(cell.strip() not in ("", "0") for cell in cells):
            out.append(_line(": ".join(name), cells))
    return out


def _row(case: dict[str, Any], name: tuple[str, str]) -> Row | None:
    return next((row for row in case["rows"] if (row["step"], row["method"]) == name), None)


def _cell(row: Row | None, show: Callable[[Row], str]) -> str:
    return show(row) if row else ""


def _times(row: Row) -> str:
    if not row.get("calls"):
        return "see below *"
    median, late = row["cpu_ms_median"], row["cpu_ms_p99"]
    return f"{_short(median)} / {_short(late)} x{late / max(median, 1e-6):.1f}"


def _quality(row: Row) -> str:
    if row.get("mpjpe_mm") is None:
        return ""
    return f"{row['mpjpe_mm']:.1f} {row['person_recall']:.3f} {row['person_precision']:.3f}"


def _memory(row: Row) -> str:
    return "" if row.get("peak_mb") is None else f"{row['peak_mb']:.0f}"


def _short(value: float) -> str:
    return f"{value:.0f}" if value >= 100.0 else f"{value:.3g}"


def _line(name: str, cells: list[str]) -> str:
    return f"  {name:<{WIDTH}.{WIDTH}}" + "".join(f"{cell:>{CELL}}" for cell in cells)


def _growth(rows: list[Row]) -> list[str]:
    if not rows:
        return []
    out = ["", "Growth: exponent b of time ~ size^b, least squares on the logarithms"]
    names = list(dict.fromkeys((row["step"], row["method"]) for row in rows))
    kinds = list(dict.fromkeys((row["in"], row["at"]) for row in rows))
    out.append(_line("", [f"in {what}" for what, _ in kinds]))
    out.append(_line("", [f"({where})" for _, where in kinds]))
    for name in names:
        cells = []
        for kind in kinds:
            match = [r for r in rows if (r["step"], r["method"]) == name and (r["in"], r["at"]) == kind]
            cells.append(f"{match[0]['exponent']:.2f}" if match else "")
        out.append(_line(": ".join(name), cells))
    return out
