"""The constructors of voting and assembly compile all kernels: the first live instant waits for none."""
import subprocess
import sys

import pytest

LATE = """
import sys
from numba.core.dispatcher import Dispatcher
from panoptic_ros.graph.build import configure, make_stage
from panoptic_ros.simulation import NOISY, SKELETON, Ring, Scene, simulate
from panoptic_ros.simulation.drawn_maps import MapDrawing, with_drawn_maps
from panoptic_ros.stage import StageContext


def kernels():
    modules = [module for name, module in sys.modules.items() if name.startswith("panoptic_ros.")]
    found = [value for module in modules for value in vars(module).values() if isinstance(value, Dispatcher)]
    return {(f.py_func.__module__, f.py_func.__name__, str(s)) for f in found for s in f.signatures}


take = simulate(Scene("test", ("walk", "talk", "reach"), Ring(5), area=1.8, degradation=NOISY), 3, 4)
settings = {"assembly": {"method": sys.argv[1]}, "voting": {"method": sys.argv[2]}}
context, configs = StageContext(take.rig, SKELETON), configure(settings)
voting, assembly = (make_stage(name, configs[name], context) for name in ("voting", "assembly"))
before = kernels()
for item in take.detection_sets():
    assembly.step(voting.step(with_drawn_maps(item, MapDrawing((256, 144)))).outputs[0])
print(sorted(kernels() - before))
"""


@pytest.mark.parametrize("methods", [("consensus", "seeds"), ("dynamic_programming", "exact")])
def test_nothing_is_compiled_late(methods):
    done = subprocess.run(
        [sys.executable, "-c", LATE, *methods], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"
