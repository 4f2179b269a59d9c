"""`panoptic bag`: repair a cut bag, or upgrade a bag of an older version."""

from __future__ import annotations

import argparse
from pathlib import Path

ENDINGS = {"repair": "-repaired", "upgrade": "-upgraded"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    texts = {
        "repair": "copy the intact part of an incomplete bag or live take to a new bag",
        "upgrade": "copy a bag of an older version to a new bag with the messages of this version",
    }
    for action, text in texts.items():
        usual = "BAG" + ENDINGS[action]
        sub = actions.add_parser(action, help=text, description=text[0].upper() + text[1:] + ".")
        sub.add_argument(
            "bag",
            type=Path,
            metavar="BAG",
            help="folder of the bag, or its file; for repair, also the folder of a live run",
        )
        sub.add_argument(
            "--out", type=Path, metavar="NEW", help=f"new bag to write; default: {usual} beside it"
        )


def run(args: argparse.Namespace) -> int:
    """Repair or upgrade a bag."""
    from panoptic_ros.io.storages import packed_name  # imported here to keep --help fast

    source: Path = args.bag
    name = Path(packed_name(source)).stem if source.is_file() else source.resolve().name
    target = args.out or source.resolve().with_name(name + ENDINGS[args.action])
    return _repair(source, target) if args.action == "repair" else _upgrade(source, target)


def _repair(source: Path, target: Path) -> int:
    from panoptic_ros.running.takes import save_take  # imported here to keep --help fast

    saved = save_take(source, target)
    for name, made in saved.bags.items():
        seconds = (made.end_ns - made.begin_ns) * 1e-9
        count = sum(made.counts.values())
        print(f"{target / name}: {count} messages on {len(made.counts)} topics, {seconds:.1f} s")
        for topic, count in sorted(made.counts.items()):
            print(f"  {count:8d}  {topic}")
    for name, count in saved.frames.items():
        print(f"{target / name}: {count} frames")
    print("nothing was lost" if not saved.lost else "lost:")
    for line in saved.lost:
        print(f"  {line}")
    return 0


def _upgrade(source: Path, target: Path) -> int:
    from panoptic_ros.io.bags import upgrade

    made = upgrade(source, target)
    if made is None:
        print(f"{source} is up to date; nothing was written")
        return 0
    print(f"{target}: {len(made.brought_up)} topics brought up to date, {len(made.kept)} as they were")
    for topic, kind in sorted(made.left_out.items()):
        name = kind.split("/")[-1]
        print(f"left out: {topic}, as {name} has changed too much; `panoptic run` computes it again")
    return 0
