"""The figures of the study of identities as text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any


def identity_lines(result: Mapping[str, Any]) -> Iterator[str]:
    """One line for each figure of `bench.identity`."""
    for kind, share in result["trials"]["kept"].items():
        yield f"{kind:20} ids kept in {share:.1%} of {result['trials']['trials']} takes"
    few = result["few_views"]
    for name, row in few["phases"].items():
        yield (
            f"{name:20} error {row['mean_mm']:.1f} mm (95 %: {row['p95_mm']:.1f}), {row['joints_given']:.0%} "
            f"of the joints given, {row['in_ellipsoid']:.1%} in the ellipsoid that should hold 95 %"
        )
    child = few["child"]
    yield (
        f"child among adults   lost for {child['lost_s']:.2f} s (at most {child['most_lost_s']:.2f}), "
        f"id kept in {child['kept']:.0%} of {few['takes']} takes"
    )
    rows = {"come and go": result["visits"]}
    rows |= {f"dressed, {name}": result["dressed"][name] for name in ("bones", "appearance")}
    for name, row in rows.items():
        yield (
            f"{name:20} {row['changes']} ids changed while there; {row['same']} of {row['returns']} "
            f"returned under their own, {row['foreign']} under somebody else's"
        )
    own = result["designated"]
    yield (
        f"a designated person  followed in {own['followed'] / max(own['there'], 1):.1%} of the instants in "
        f"which he can be seen; a bystander had the id in {own['taken']}"
    )


def child_lines(result: Mapping[str, Any]) -> Iterator[str]:
    """One line for each take of `bench.hidden_child`, and how many are good."""
    for row in result["takes"]:
        losers = ", ".join(f"{name} {count}" for name, count in row["losers"].items()) or "nobody"
        yield (
            f"seed {row['seed']}: {row['cameras']} cameras, {row['rate']:.1f} Hz; lost for "
            f"{row['lost_s']:.2f} s (at most {row['longest_s']:.2f}), "
            f"id {'kept' if row['kept'] else 'changed'}; by: {losers}; {row['ghosts']:.3f} ghosts"
        )
    yield f"lost for at most 0.2 s with the id kept: {result['good']} of {len(result['takes'])} takes"
