"""`panoptic models`: list, fetch and check pose models."""

from __future__ import annotations

import argparse
from pathlib import Path

from panoptic_ros.io.models import DEFAULT_MODEL, card_names, fetch, is_cached, load_detector, read_card
from panoptic_ros.io.models.check import check_model
from panoptic_ros.view.progress import PassBar


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the actions and their arguments."""
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    actions.add_parser("list", help="list the installed model cards and the available models")
    fetching = actions.add_parser("fetch", help="download a model and convert it into the cache")
    fetching.add_argument(
        "name", nargs="?", default=DEFAULT_MODEL, help=f"name of the model; default: {DEFAULT_MODEL}"
    )
    checking = actions.add_parser("check", help="load a model and run it once")
    checking.add_argument(
        "name", nargs="?", default=DEFAULT_MODEL, help="name of a model, model card or ONNX file"
    )


def run(args: argparse.Namespace) -> int:
    """Run the chosen action."""
    if args.action == "list":
        _list()
    elif args.action == "fetch":
        _fetch(args.name)
    else:
        _check(args.name)
    return 0


def _list() -> None:
    rows = [("MODEL", "FAMILY", "LICENCE", "STATE")]
    for name in card_names():
        source = read_card(name)
        if is_cached(source):
            state = "ready"
        elif source.origin is not None:
            state = f"panoptic models fetch {name}"
        else:
            state = "example card: copy it and name your file"
        rows.append((name, source.card.family, source.card.licence, state))
    widths = [max(len(row[column]) for row in rows) for column in range(3)]
    for row in rows:
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths)) + "  " + row[3])


def _fetch(name: str) -> None:
    with PassBar(name, total=None) as bar:
        written = fetch(name, lambda doing, megabytes: bar.show(megabytes, f"{doing} ... {megabytes:.0f} MB"))
    for path in written:
        print(f"{path.stem}: converted, checked against the original, written to {path}")
    if not written:
        print(f"{name}: already there, nothing to do")


def _check(name: str) -> None:
    model, source = load_detector(name), read_card(name)
    result = check_model(model, source)
    shapes = ", ".join(f"{role} {'x'.join(map(str, shape))}" for role, shape in result.shapes.items())
    print(f"{model.card.name}: {Path(source.model_path)} runs and gives {shapes}")
    if result.compared:
        print("the values on the test picture are the expected ones")
    if model.person_detector is not None:
        print(f"people are found by {model.person_detector.card.name}")
