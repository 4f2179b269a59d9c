"""A class name exists once in the package, so a reader who knows it knows which class is meant."""

import ast
from collections import defaultdict
from pathlib import Path

import layers
import pytest

import panoptic_ros

SOURCES = {
    name: path.read_text() for name, path in layers.modules(Path(panoptic_ros.__file__).parent).items()
}


def modules_by_class(sources):
    """Modules that define a class, by the name of the class."""
    found = defaultdict(list)
    for module, source in sources.items():
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.ClassDef):
                found[node.name].append(module)
    return found


def repeated(sources):
    return {name: modules for name, modules in modules_by_class(sources).items() if len(modules) > 1}


def test_no_class_name_exists_twice():
    assert repeated(SOURCES) == {}


@pytest.mark.parametrize(
    "sources",
    [
        {"p.a": "class Track: ...", "p.b": "class Track: ..."},
        {"p.a": "class Track: ...", "p.b": "def f():\n    class Track(int): ..."},
        {"p.a": "class _Gate: ...\nclass Clock:\n    class _Gate: ..."},
    ],
)
def test_a_name_that_exists_twice_would_be_found(sources):
    assert len(repeated(sources)) == 1


def test_equal_names_of_other_things_are_no_repetition():
    sources = {
        "p.a": "class Track: ...\nclass _Track: ...",
        "p.b": "from p.a import Track\nt = 'class Track: ...'",
    }
    assert repeated(sources) == {}
