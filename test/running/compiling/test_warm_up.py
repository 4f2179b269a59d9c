"""Compiling ahead leaves no kernel out, tells how far it is, and is quick when there is nothing to do."""

import inspect
import re
import subprocess
import sys
from importlib import import_module
from itertools import chain
from pathlib import Path

import layers
import pytest
from numba.core.dispatcher import Dispatcher

import panoptic_ros
from panoptic_ros.errors import ContractError
from panoptic_ros.running.compiling import warm_up

ROOT = Path(panoptic_ros.__file__).parent
CALLED = """
import sys
from numba.core.dispatcher import Dispatcher
from panoptic_ros.running.compiling.kernel_tasks import TASKS

for task in TASKS.values():
    task()
for name, module in list(sys.modules.items()):
    for kernel in vars(module).values() if name.startswith("panoptic_ros.") else ():
        if isinstance(kernel, Dispatcher) and kernel.signatures:
            print(kernel.py_func.__module__ + "." + kernel.py_func.__qualname__)
"""  # the names of kernels that tasks have called, in a process where nobody else did


def test_every_kernel_is_compiled_by_some_task():
    """Tasks alone call all compiled functions of the sources, or functions of which those are parts."""
    wanted = [kernel for module, path in layers.modules(ROOT).items() for kernel in _kernels(module, path)]
    told = subprocess.run([sys.executable, "-c", CALLED], capture_output=True, text=True, check=True).stdout
    names = set(told.split())
    waiting = [kernel for kernel in wanted if _name(kernel) in names]
    reached = set(waiting)
    while waiting:
        parts = _called(waiting.pop()) - reached
        waiting += parts
        reached |= parts
    assert len(wanted) > 150
    assert [_name(kernel) for kernel in wanted if kernel not in reached] == []


def _name(kernel):
    return f"{kernel.py_func.__module__}.{kernel.py_func.__qualname__}"


def _kernels(module, path):
    if module.startswith("panoptic_ros.study."):
        return []  # studies compile their baselines themselves
    names = "|".join({"inlined", "njit", *re.findall(r"^(\w+) = njit\(", path.read_text(), re.M)})
    found = re.findall(rf"^@(?:{names})\b.*\ndef (\w+)", path.read_text(), re.M)
    return [getattr(import_module(module), name) for name in found]


def _called(kernel):
    """Kernels that it names, alone or in a module."""
    used = inspect.getclosurevars(kernel.py_func).globals.values()
    modules = [vars(value).values() for value in used if inspect.ismodule(value)]
    return {value for value in chain(used, *modules) if isinstance(value, Dispatcher)}


def test_progress_and_the_mark(monkeypatch, tmp_path):
    monkeypatch.setattr(warm_up, "cache_folder", lambda: tmp_path)
    assert not warm_up.is_warm()
    told = []
    warm_up.warm_up(lambda share, name: told.append((share, name)), 1, ("occluders", "all votes"))
    assert told == [(0.5, "occluders"), (1.0, "all votes")]
    assert warm_up.is_warm()


def test_a_process_that_breaks_down_is_told(monkeypatch, tmp_path, capfd):
    monkeypatch.setattr(warm_up, "cache_folder", lambda: tmp_path)
    with pytest.raises(ContractError, match="broke down"):
        warm_up.warm_up(lambda share, name: None, 2, ("no such task", "occluders"))
    assert "KeyError: 'no such task'" in capfd.readouterr().err
    assert not warm_up.is_warm()
