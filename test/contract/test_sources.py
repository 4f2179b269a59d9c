"""Each source of a run makes its plan by one protocol, and one function divides graphs into nodes."""

import ast
from pathlib import Path

import panoptic_ros

ROOT = Path(panoptic_ros.__file__).parent
PLANS = ROOT / "running" / "plans"
DIVIDES = "write_launch_file"


def functions(folder):
    """All functions at the top of the modules of a folder."""
    for path in sorted(folder.glob("*.py")):
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.FunctionDef):
                yield node


def calls(path, name):
    return [
        node
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == name
    ]


def test_every_source_takes_the_options_of_a_run_last_and_gives_a_plan():
    """What names the source comes before: bound with `functools.partial`, it is an `options.Source`."""
    sources = {node.name: node for node in functions(PLANS) if node.name.startswith("plan_")}
    assert {"plan_capture", "plan_videos", "plan_devices", "plan_bags", "plan_drivers"} <= set(sources)
    for name, node in sources.items():
        last = node.args.args[-1]
        assert (last.arg, ast.unparse(last.annotation)) == ("options", "RunOptions"), name
        assert ast.unparse(node.returns) == "Plan", name


def test_plans_are_made_among_the_sources_only():
    studies = ROOT / "study"
    elsewhere = [p for p in ROOT.rglob("*.py") if PLANS not in p.parents and studies not in p.parents]
    assert [path for path in elsewhere if calls(path, "Plan")] == []


def test_panoptic_run_and_ros2_launch_divide_the_graph_by_one_function():
    launched = ROOT.parent / "launch" / "panoptic.launch.py"
    assert calls(ROOT / "running" / "runs" / "over_dds.py", DIVIDES) and calls(launched, DIVIDES)
    others = [launched, *(ROOT / "running").rglob("*.py"), *(ROOT / "cli").rglob("*.py")]
    assert [path for path in others if "AFTER_DETECTION" in path.read_text()] == []
