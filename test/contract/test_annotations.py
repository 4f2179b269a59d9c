"""Only functions that numba compiles go without annotations; mypy, which knows modules, checks the rest."""

import re
import sys
from pathlib import Path

import annotations
import layers
import pytest

import panoptic_ros

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(panoptic_ros.__file__).parent
MODULES = layers.modules(ROOT)
FREED = {
    name
    for rule in tomllib.loads((ROOT.parent / "pyproject.toml").read_text())["tool"]["mypy"]["overrides"]
    if rule.get("disallow_untyped_defs") is False
    for name in rule["module"]
}


def test_modules_that_mypy_frees_are_those_with_unannotated_kernels():
    found = {
        name
        for name, path in MODULES.items()
        if any(compiled for _, compiled in annotations.unannotated(path.read_text()))
    }
    assert found == FREED


def test_nothing_but_kernels_goes_without_annotations():
    found = [
        f"{name}.{function}"
        for name, path in MODULES.items()
        for function, compiled in annotations.unannotated(path.read_text())
        if not compiled
    ]
    assert found == []


def test_whoever_silences_mypy_says_which_rule_and_why():
    bare = [
        f"{name}: {line.strip()}"
        for name, path in MODULES.items()
        for line in path.read_text().splitlines()
        if "type: ignore" in line and not re.search(r"# type: ignore\[[a-z-]+\]  # \w", line)
    ]
    assert bare == []


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("def f(a: int) -> int: ...", []),
        ("def f(a) -> int: ...", [("f", False)]),
        ("def f(a: int): ...", [("f", False)]),
        ("class A:\n    def __init__(self, a: int): ...", []),
        ("class A:\n    def __init__(self, a): ...", [("__init__", False)]),
        ("@njit\ndef f(a): ...", [("f", True)]),
        ("@numba.njit(cache=True)\ndef f(a): ...", [("f", True)]),
        ("_jit = njit(cache=True)\n@_jit\ndef f(a): ...", [("f", True)]),
        ("@cached\ndef f(a): ...", [("f", False)]),
        ("@njit\ndef f(a: int) -> int: ...", []),
    ],
)
def test_what_lacks_annotations(source, expected):
    assert list(annotations.unannotated(source)) == expected
