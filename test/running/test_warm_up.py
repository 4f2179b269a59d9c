"""Compiling ahead leaves no kernel out, tells how far it is, and is quick when there is nothing to do."""
import re
from pathlib import Path

import layers
import pytest

import panoptic_ros
from panoptic_ros.errors import ContractError
from panoptic_ros.kernels.cache import module_folder
from panoptic_ros.running import kernel_tasks, warm_up

ROOT = Path(panoptic_ros.__file__).parent


def test_every_kernel_is_compiled_by_some_part():
    """The names of all compiled functions, as the sources have them, are in the cache afterwards."""
    warm_up.warm_up(lambda share, name: None)
    missing, count = [], 0
    for module, path in layers.modules(ROOT).items():
        if module.startswith("panoptic_ros.bench."):
            continue  # benches compile their baselines themselves
        names = "|".join({"njit", *re.findall(r"^(\w+) = njit\(", path.read_text(), re.M)})
        wanted = re.findall(rf"^@(?:{names})\b.*\ndef (\w+)", path.read_text(), re.M)
        count += len(wanted)
        if wanted:
            kept = {kernel.name.partition("-")[0] for kernel in module_folder(module).glob("*.nbi")}
            missing += [f"{module}.{name}" for name in wanted if f"{path.stem}.{name}" not in kept]
    assert count > 150
    assert missing == []


def test_progress_and_the_mark(monkeypatch, tmp_path):
    monkeypatch.setattr(warm_up, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(kernel_tasks, "TASKS", {"occluders": None, "rendering": None})
    assert not warm_up.is_warm()
    told = []
    warm_up.warm_up(lambda share, name: told.append((share, name)), processes=1)
    assert told == [(0.5, "occluders"), (1.0, "rendering")]
    assert warm_up.is_warm()


def test_a_process_that_breaks_down_is_told(monkeypatch, tmp_path):
    monkeypatch.setattr(warm_up, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(kernel_tasks, "TASKS", {"no such part": None})
    with pytest.raises(ContractError, match="no such part"):
        warm_up.warm_up(lambda share, name: None, processes=1)
    assert not warm_up.is_warm()
