"""Named scenes. A scene defines everything except the seed."""

from __future__ import annotations

from dataclasses import dataclass, replace

from panoptic_ros.errors import UsageError
from panoptic_ros.simulation.degradation import CLEAN, MILD, NOISY, Degradation
from panoptic_ros.simulation.detector import Absence
from panoptic_ros.simulation.generators import Generator
from panoptic_ros.simulation.rigs import VGA, Corners, Dome, Lens, PanelDome, RigPlan, Ring
from panoptic_ros.simulation.stagings import STAGINGS
from panoptic_ros.simulation.timing import IN_STEP, OwnClocks, Timing
from panoptic_ros.simulation.walls import Wall


@dataclass(frozen=True)
class SimulatedScene:
    """Declarative scene: people, cameras, and the faults of the cameras' detector.

    Raises:
        UsageError: For an unknown staging or inconsistent values.
    """

    about: str  # purpose in a few words
    activities: tuple[str, ...]  # one per person, see people.ACTIVITIES
    rig: RigPlan
    staging: str = "random"  # see stagings.STAGINGS
    area: float = 2.3  # m; radius of the space that people use
    table: float = 0.0  # m; radius of a round table centred at the origin, 0 = none
    walls: tuple[Wall, ...] = ()  # walls that hide people
    degradation: Degradation = CLEAN
    timing: Timing = IN_STEP
    absences: tuple[Absence, ...] = ()  # periods in which people or joints are not detected
    frames: int = 90
    rendered: bool = False  # the take has images instead of simulated detections

    def __post_init__(self) -> None:
        if self.staging not in STAGINGS:
            raise UsageError(f"unknown staging {self.staging!r}; there are {', '.join(STAGINGS)}")
        if self.frames < 1 or not self.activities:
            raise UsageError("a scene needs at least one frame and one person")


LOWER_HALF = ("BodyCenter", *(side + name for side in "lr" for name in ("Hip", "Knee", "Ankle")))


def _walk_out(person: int, two: float, one: float, end: float) -> tuple[Absence, ...]:
    """Return absences that reduce a person's views, for a rig of eight cameras.

    From `two` s on, only cameras 2 and 4 see the person, and only its upper half. From `one` s on, only
    camera 2 does. The absences end at `end` s.
    """
    others = (0, 1, 3, 5, 6, 7)
    return (
        Absence(person, two, end, others),
        Absence(person, two, end, joints=LOWER_HALF),
        Absence(person, one, end, (4,)),
    )


_FOUR = ("walk", "talk", "reach", "turn")
_EIGHT = ("walk", "walk", "talk", "reach", "turn", "crouch", "wave", "sit-down")
_TWO_CLOCKS = Timing(
    29.97,
    generators=(
        Generator("A", "25", 10 * 3600 * 25, drift_ppm=-7.0),  # first label 10:00:00:00
        # first label 11:00:17:04
        Generator("B", "29.97", (11 * 3600 + 17) * 30 + 4, begin_s=0.013, drift_ppm=31.0),
    ),
)
_VGA_LENS = Lens(VGA, (425.0, 440.0), distorted_every=0)
_VGA_RING = Ring(6, radius=3.9, heights=(1.2, 2.6), lens=_VGA_LENS)
_NEAR_RING = Ring(8, radius=3.3, heights=(1.0, 2.8), lens=_VGA_LENS)

SCENES: dict[str, SimulatedScene] = {
    "clean-4p5v": SimulatedScene("1 px of noise, bodies hide joints", _FOUR, Ring(5)),
    "noisy-4p5v": SimulatedScene("all faults of a detector", _FOUR, Ring(5), degradation=NOISY),
    "noisy-8p5v": SimulatedScene(
        "crowded, all faults", _EIGHT, Ring(5, radius=4.6), area=2.7, degradation=NOISY
    ),
    "noisy-8p10v": SimulatedScene(
        "crowded, all faults, more views", _EIGHT, Ring(10, radius=4.6), area=2.7, degradation=NOISY
    ),
    "noisy-8p31v": SimulatedScene("a dome of HD cameras", _EIGHT, Dome(31), area=1.8, degradation=NOISY),
    "exchanged-4p5v": SimulatedScene(
        "most views exchange left and right for half a second",
        _FOUR,
        Ring(5),
        degradation=replace(MILD, back_swap=0.7, limb_swap=0.2, hold=15),
    ),
    "ghosts-8p31v": SimulatedScene(
        "a false person in every view of a dome",
        _EIGHT,
        Dome(31),
        area=1.8,
        degradation=replace(NOISY, ghosts=1.0),
        frames=40,
    ),
    "fragments-8p5v": SimulatedScene(
        "half of the joints missing, and a third of the people",
        _EIGHT,
        Ring(5, radius=4.6),
        area=2.7,
        degradation=replace(NOISY, joint_miss=0.5, person_miss=0.3, fewest_joints=1, hold=5),
    ),
    "crossing": SimulatedScene(
        "two people meet head-on",
        ("walk", "walk"),
        Ring(5),
        staging="crossing",
        degradation=replace(MILD, merge=0.10),
    ),
    "embrace-2p5v": SimulatedScene(
        "two people embrace",
        ("walk", "walk"),
        Ring(5),
        staging="embrace",
        degradation=replace(MILD, merge=0.10),
        frames=100,
    ),
    "rooms-4p31v": SimulatedScene(
        "walls between people and most cameras",
        ("talk", "reach", "turn", "wave"),
        Ring(31, radius=4.4),
        staging="rooms",
        degradation=NOISY,
        walls=(Wall((6.0, 0.1, 2.6)), Wall((0.1, 6.0, 2.6))),
    ),
    "occluded": SimulatedScene(
        "no camera sees person 0 for a second",
        ("walk", "walk", "talk"),
        Ring(5),
        degradation=MILD,
        absences=(Absence(0, 1.0, 2.0),),
    ),
    "bystanders": SimulatedScene(
        "three people behind the cameras",
        ("walk", "talk", "reach"),
        Ring(5),
        staging="bystanders",
        degradation=MILD,
    ),
    "enter-leave": SimulatedScene(
        "people come and go",
        ("walk", "walk", "walk", "talk"),
        Ring(5),
        staging="enter-leave",
        degradation=MILD,
        frames=150,
    ),
    "three-views-2p": SimulatedScene("few views", ("walk", "talk"), Corners(3), area=1.6, degradation=MILD),
    "dome-480-7p": SimulatedScene(
        "480 VGA views",
        ("walk", "turn", "talk", "reach", "crouch", "wave", "talk"),
        PanelDome(24),
        area=1.6,
        degradation=replace(NOISY, noise_px=1.0, size_px=250.0, outlier_px=20.0),
        timing=Timing(rate=25.0),
        frames=10,
    ),
    "unsync-5v": SimulatedScene(
        "cameras out of phase, fast motion",
        ("run", "wave", "walk", "wave"),
        Ring(5),
        degradation=replace(CLEAN, noise_px=1.5, joint_miss=0.03),
        timing=Timing(phase=1.0 / 60.0, stamp_jitter=0.0005),
    ),
    "mixed-rates": SimulatedScene(
        "25 and 29.97 Hz, drift, lost frames",
        ("walk", "talk", "wave"),
        Corners(4),
        area=1.9,
        degradation=MILD,
        timing=Timing(29.97, (25.0, 29.97), phase=0.02, drift_ppm=30.0, stamp_jitter=0.001, drop=0.02),
    ),
    "two-clocks-3p6v": SimulatedScene(
        "cameras locked to timecodes of 25 and 29.97 Hz, and their sound",
        ("walk", "wave", "run"),
        Ring(6),
        degradation=MILD,
        timing=_TWO_CLOCKS,
        frames=150,
    ),
    "own-clocks-3p5v": SimulatedScene(
        "cameras with clocks seconds apart, and their sound",
        ("walk", "talk", "wave"),
        Ring(5, radius=3.0),
        area=1.6,
        degradation=MILD,
        frames=150,
        timing=Timing(stamp_jitter=0.0005, own_clocks=OwnClocks()),
    ),
    "sitting-group-6p5v": SimulatedScene(
        "round a table, persistent faults",
        ("sit",) * 6,
        Ring(5, radius=3.2),
        staging="table",
        table=0.60,
        timing=Timing(rate=25.0),
        degradation=replace(
            NOISY,
            size_px=500.0,
            memory=0.5,
            outlier=0.02,
            back_swap=0.10,
            merge=0.10,
            ghosts=0.1,
            hold=4,
        ),
    ),
    "walk-out-3p8v": SimulatedScene(
        "eight views of one person become two of the upper half, then one",
        ("walk", "talk", "reach"),
        Ring(8),
        degradation=MILD,
        frames=210,
        absences=_walk_out(0, 3.0, 4.5, 6.0),
    ),
    "child-among-3p8v": SimulatedScene(
        "a child among adults who bend over it, seen by two views for a second",
        ("stand", "crouch", "crouch", "crouch"),
        Ring(8),
        staging="among",
        degradation=MILD,
        frames=150,
        absences=(Absence(0, 2.0, 3.0, (1, 2, 3, 5, 6, 7)),),
    ),
    "rendered-4p6v": SimulatedScene(
        "images of four people in six VGA views",
        ("walk", "talk", "wave", "stand"),
        _VGA_RING,
        staging="spread",
        timing=Timing(rate=25.0),
        frames=75,
        rendered=True,
    ),
    "rendered-2p4v": SimulatedScene(
        "images of two people in four VGA views",
        ("walk", "reach"),
        replace(_VGA_RING, cameras=4),
        staging="spread",
        timing=Timing(rate=25.0),
        frames=75,
        rendered=True,
    ),
    "rendered-clocks-2p4v": SimulatedScene(
        "images of cameras locked to two timecodes, and their sound",
        ("walk", "wave"),
        replace(_VGA_RING, cameras=4),
        staging="spread",
        timing=_TWO_CLOCKS,
        frames=75,
        rendered=True,
    ),
    "rendered-own-clocks-2p4v": SimulatedScene(
        "images of cameras with clocks seconds apart, and their sound",
        ("walk", "wave"),
        replace(_VGA_RING, cameras=4),
        staging="spread",
        rendered=True,
        frames=75,
        timing=Timing(rate=25.0, own_clocks=OwnClocks()),
    ),
    "rendered-3p8v": SimulatedScene(
        "images of three people close together in eight views",
        ("talk", "wave", "walk"),
        _NEAR_RING,
        staging="spread",
        area=1.3,
        timing=Timing(rate=25.0),
        frames=50,
        rendered=True,
    ),
    "rendered-6p8v": SimulatedScene(
        "images of a crowd in eight views",
        ("walk", "talk", "wave", "stand", "turn", "reach"),
        replace(_NEAR_RING, radius=3.9),
        area=1.6,
        timing=Timing(rate=25.0),
        frames=50,
        rendered=True,
    ),
    "rendered-crossing-2p8v": SimulatedScene(
        "images of two people who meet head-on",
        ("walk", "walk"),
        replace(_NEAR_RING, radius=3.9),
        staging="crossing",
        timing=Timing(rate=25.0),
        frames=60,
        rendered=True,
    ),
    "rendered-embrace-2p8v": SimulatedScene(
        "images of two people who embrace",
        ("walk", "walk"),
        replace(_NEAR_RING, radius=3.9),
        staging="embrace",
        timing=Timing(rate=25.0),
        frames=85,
        rendered=True,
    ),
    "rendered-enter-4p8v": SimulatedScene(
        "images of people who come and go",
        ("walk", "walk", "walk", "talk"),
        replace(_NEAR_RING, radius=3.9),
        staging="enter-leave",
        timing=Timing(rate=25.0),
        frames=90,
        rendered=True,
    ),
    "rendered-close-3p8v": SimulatedScene(
        "images of three people within arm's reach: one sits down, one crouches",
        ("sit-down", "crouch", "reach"),
        _NEAR_RING,
        staging="spread",
        area=0.8,
        timing=Timing(rate=25.0),
        frames=60,
        rendered=True,
    ),
    "rendered-child-4p8v": SimulatedScene(
        "images of a child among three adults who crouch round it",
        ("stand", "crouch", "crouch", "crouch"),
        _NEAR_RING,
        staging="among",
        timing=Timing(rate=25.0),
        frames=100,
        rendered=True,
    ),
    "rendered-table-4p8v": SimulatedScene(
        "images of four people round a table",
        ("sit",) * 4,
        _NEAR_RING,
        staging="table",
        table=0.60,
        timing=Timing(rate=25.0),
        frames=50,
        rendered=True,
    ),
}


def scene(name: str) -> SimulatedScene:
    """Return the scene with this name.

    Raises:
        UsageError: If there is none.
    """
    if name not in SCENES:
        raise UsageError(f"unknown scene {name!r}; there are {', '.join(SCENES)}")
    return SCENES[name]
