"""Simulated captures with exact ground truth: people, cameras, faulty 2D detections, and images.

Input: a declarative `SimulatedScene` (see `SCENES`) and a seed. Output: a `Simulation` with the rig, the
detection sets of all instants (`detection_sets`) and the true skeletons (`truth_document`). The package
`rendering` adds images with depth and person ids per pixel. The same scene and seed give the same take.

People are bodies of constant limb lengths. Their joints are smooth functions of time, exact at any instant
(`people`, `body`), so cameras need not be synchronised (`timing`). A simulated detector (`detector`) projects
them and adds the faults of a `Degradation`. The faults are noise that depends on quality, misses, outliers,
occlusion by bodies and a table, guesses, swaps, merges, duplicates and ghosts.

Limits: bodies are kinematic (no contact forces), people do not avoid each other's limbs, and there are no
fingers. Noise is unbiased about the true joint, unlike the noise of real detectors. Calibration is exact.
"""

from panoptic_ros.simulation.degradation import CLEAN, MILD, NOISY, Degradation
from panoptic_ros.simulation.detector import Absence, Sightings, SimulatedDetector
from panoptic_ros.simulation.people import ACTIVITIES, SimulatedPerson
from panoptic_ros.simulation.rigs import Corners, Dome, Lens, PanelDome, Ring, farthest_first
from panoptic_ros.simulation.scenes import SCENES, SimulatedScene, scene
from panoptic_ros.simulation.simulate import Simulation, simulate
from panoptic_ros.simulation.skeleton import JOINTS, SKELETON
from panoptic_ros.simulation.timing import Timing

__all__ = [
    "ACTIVITIES",
    "CLEAN",
    "JOINTS",
    "MILD",
    "NOISY",
    "SCENES",
    "SKELETON",
    "Absence",
    "Corners",
    "Degradation",
    "Dome",
    "Lens",
    "PanelDome",
    "Ring",
    "Sightings",
    "SimulatedDetector",
    "SimulatedPerson",
    "SimulatedScene",
    "Simulation",
    "Timing",
    "farthest_first",
    "scene",
    "simulate",
]
