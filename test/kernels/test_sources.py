"""The closure of a module holds all that it imports, as Python's own parser sees it."""

import ast
from pathlib import Path

import layers

import panoptic_ros
from panoptic_ros.kernels import sources

ROOT = Path(panoptic_ros.__file__).parent
MODULES = layers.modules(ROOT)


def test_every_import_that_python_sees_is_found():
    missing = []
    for name, path in MODULES.items():
        wanted = {
            target
            for node in ast.walk(ast.parse(path.read_text()))
            for target in _targets(node, name)
            if target in MODULES
        }
        known = set(sources.closure(name))
        missing += [(name, target) for target in wanted if MODULES[target] not in known]
    assert missing == []


def test_a_closure_is_closed():
    for path in sources.closure("panoptic_ros.solving.joints"):
        name = next(name for name, other in MODULES.items() if other == path)
        assert set(sources.closure(name)) <= set(sources.closure("panoptic_ros.solving.joints"))


def test_compiled_code_does_not_depend_on_the_command_line():
    found = sources.closure("panoptic_ros.solving.joints")
    rooms = {path.relative_to(ROOT).parts[0] for path in found}
    assert {"solving", "kernels", "domain"} <= rooms
    assert not rooms & {"cli", "nodes", "running", "view", "io", "graph"}


def test_the_hash_of_all_sources_is_that_of_their_contents():
    assert sources.all_sources_hash() == sources.all_sources_hash()
    assert sources.closure_hash("panoptic_ros.voting.votes") != sources.closure_hash("panoptic_ros.errors")


def _targets(node: ast.AST, module: str) -> list[str]:
    """Modules that an import statement may load, with the packages around them."""
    if isinstance(node, ast.Import):
        found = [alias.name for alias in node.names]
    elif isinstance(node, ast.ImportFrom):
        assert not node.level, f"{module}: a relative import, which the hash of sources does not see"
        found = [f"{node.module}.{alias.name}" for alias in node.names] + [node.module or ""]
    else:
        return []
    return [".".join(name.split(".")[:n]) for name in found for n in range(1, name.count(".") + 2)]
