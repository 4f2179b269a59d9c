"""`panoptic config`: show all parameters; write the files that are generated from them."""
from __future__ import annotations

import argparse
from pathlib import Path

from panoptic_ros.errors import UsageError
from panoptic_ros.graph.build import config_class
from panoptic_ros.graph.nodes import NODES
from panoptic_ros.io.files import write_bytes
from panoptic_ros.io.parameter_files import parameter_page, parameter_yaml
from panoptic_ros.io.resources import share_folder


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the verb."""
    parser.add_argument("action", choices=("show", "write"), help="print them, or write the generated files")
    parser.add_argument("stage", nargs="?", choices=tuple(NODES), help="show this stage only")


def generated_files() -> dict[str, str]:
    """Content of every generated file by its path in the repository."""
    classes = {name: config_class(name) for name in NODES}
    files = {f"config/{name}.yaml": parameter_yaml(name, cls) for name, cls in classes.items()}
    files["docs/parameters.md"] = parameter_page(classes)
    return files


def run(args: argparse.Namespace) -> int:
    """Show or write."""
    files = generated_files()
    if args.action == "show":
        shown = [f"config/{args.stage}.yaml"] if args.stage else ["docs/parameters.md"]
        print("\n".join(files[name] for name in shown))
        return 0
    root = share_folder()
    if not (root / "setup.py").is_file():
        raise UsageError(f"config write is for a checkout of the repository; {root} is an installation")
    for name, text in files.items():
        write_bytes(Path(root / name), text.encode())
        print(name)
    return 0
