"""Compiling ahead leaves no kernel out, tells how far it is, and is quick when there is nothing to do."""
import inspect
import re
from importlib import import_module
from itertools import chain
from pathlib import Path

import layers
import pytest
from numba.core.dispatcher import Dispatcher

import panoptic_ros
from panoptic_ros.errors import ContractError
from panoptic_ros.kernels.cache import module_folder
from panoptic_ros.running.compiling import warm_up

ROOT = Path(panoptic_ros.__file__).parent


def test_every_kernel_is_compiled_by_some_task():
    """All compiled functions, as the sources have them, are in the cache afterwards, or parts of those."""
    warm_up.warm_up(lambda share, name: None)
    wanted = [kernel for module, path in layers.modules(ROOT).items() for kernel in _kernels(module, path)]
    waiting = [kernel for kernel in wanted if _is_kept(kernel)]
    reached = set(waiting)
    while waiting:
        parts = _called(waiting.pop()) - reached
        waiting += parts
        reached |= parts
    assert len(wanted) > 150
    assert [kernel for kernel in wanted if kernel not in reached] == []


def _kernels(module, path):
    if module.startswith("panoptic_ros.bench."):
        return []  # benches compile their baselines themselves
    names = "|".join({"inlined", "njit", *re.findall(r"^(\w+) = njit\(", path.read_text(), re.M)})
    found = re.findall(rf"^@(?:{names})\b.*\ndef (\w+)", path.read_text(), re.M)
    return [getattr(import_module(module), name) for name in found]


def _is_kept(kernel):
    function = kernel.py_func
    stem = function.__module__.rpartition(".")[2]
    return any(module_folder(function.__module__).glob(f"{stem}.{function.__qualname__}-*.nbi"))


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
