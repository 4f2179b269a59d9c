"""List of all studies: the module, class and subject of each.

`study_of` imports the module of a study on demand.
"""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from panoptic_ros.errors import UsageError, nearest
from panoptic_ros.running.arguments import output_file
from panoptic_ros.study.study import Study

STUDIES: dict[str, tuple[str, str]] = {  # value: (MODULE:CLASS inside this package, subject)
    "ablation": (
        "ablation.ablation:Ablation",
        "effect of every mechanism of the core: each off in turn, on simulations and recordings",
    ),
    "accidents": (
        "faults.faults:Accidents",
        "data lost by accidents of live takes: full disks, kills, power cuts",
    ),
    "alignment": (
        "bodies.alignment:Alignment",
        "heading and clock of IMUs from motion, and lengths of bodies",
    ),
    "borders": (
        "fusion.borders:Borders",
        "people cut by image borders: with and without the model of borders, and an oracle",
    ),
    "calibration": (
        "calibration.boards:Calibration",
        "cameras from simulated recordings of a board: errors beside the Cramer-Rao bound, time",
    ),
    "calibration-pattern": (
        "calibration.pattern:CalibrationPattern",
        "cameras from a projected pattern: errors beside the bound; time and memory with 480 and 521 cameras",
    ),
    "calibration-people": (
        "calibration.people:CalibrationPeople",
        "cameras from people who walk, simulated or recorded: errors beside predicted ones, clocks, time",
    ),
    "calibration-sessions": (
        "calibration.sessions:CalibrationSessions",
        "cameras from recorded corners of a board, scored on corners that are left out",
    ),
    "camera-health": (
        "calibration.camera_health:CameraHealth",
        "cameras that turn or zoom while people walk: delay of the alarm, false alarms, error after repair",
    ),
    "cameras": (
        "rigs.cameras:Cameras",
        "PCK by the number of cameras of a rig (Joo et al. 2017, Fig. 8)",
    ),
    "captures": (
        "bodies.captures:Captures",
        "bodies in captures with unknown headings and clocks, bystanders, people who leave",
    ),
    "child": (
        "people.hidden_child:Child",
        "a child hidden by adults, in rendered takes: seconds lost, identity",
    ),
    "clocks": (
        "timing.clocks:Clocks",
        "timestamps corrected by timecode against the truth: an hour of mixed rates, and events",
    ),
    "continuous": (
        "continuous.continuous:Continuous",
        "motion from cameras that were never synchronised, by the speed of joints (Elhayek et al. 2012, "
        "Fig. 8)",
    ),
    "continuous-time": (
        "continuous.cost:ContinuousTime",
        "continuous time: processor time and memory by the length of a recording, and time of an answer",
    ),
    "detection": (
        "detection.detection:Detection",
        "processor time and accuracy of rationed detection, regions and propagation, beside detection at "
        "every image",
    ),
    "devices": (
        "bodies.devices:Devices",
        "IMUs worn otherwise than stated: reports, their delay, and the correction",
    ),
    "faults": (
        "faults.faults:Faults",
        "damaged and hostile files of every format",
    ),
    "fill": (
        "people.fill:Fill",
        "fit of bodies, and accuracy of joints in few views with and without them",
    ),
    "graph": (
        "live.graph:Graph",
        "live graph after detection, over DDS: losses, latency, processor time",
    ),
    "identity": (
        "people.identity_study:Identity",
        "identities of people who are hidden, cross, come and go, or are in few views",
    ),
    "kinematics": (
        "bodies.goals:Goals",
        "bodies beside the paper's solver, against the goals (Malleson et al. 2020)",
    ),
    "kinematics-inputs": (
        "bodies.inputs:Inputs",
        "bodies by the number of cameras and IMUs (Malleson et al. 2020, Fig. 7)",
    ),
    "kinematics-live": (
        "bodies.times:KinematicsLive",
        "bodies in the live graph: latency, processor time",
    ),
    "kinematics-time": (
        "bodies.times:KinematicsTime",
        "bodies: processor time per solve and per instant",
    ),
    "live": (
        "live.live:LiveStudy",
        "live graph from cameras to skeletons, with recordings played as cameras: losses, latency, "
        "processor time",
    ),
    "ltc": (
        "timing.ltc:Ltc",
        "timecode decoding: recall, wrong labels, exactness, latency and speed, beside libltc",
    ),
    "ltc-impairments": (
        "timing.ltc:LtcImpairments",
        "timecode under random combinations of impairments",
    ),
    "ltc-sounds": (
        "timing.ltc:LtcSounds",
        "words that the decoder reads in sounds without timecode",
    ),
    "ltc-starts": (
        "timing.ltc:LtcStarts",
        "starts of timecode after noise, silence, tones and clicks",
    ),
    "network": (
        "live.network:Network",
        "transport of 2D people between hosts that lose packets (network namespaces, root)",
    ),
    "nodes": (
        "rigs.cameras:Nodes",
        "accuracy of nodes and skeletons with all cameras of a rig (Joo et al. 2017, Table 3)",
    ),
    "offsets": (
        "timing.offsets:Offsets",
        "clocks from motion against the truth: errors, stated deviations, poses",
    ),
    "offsets-shifted": (
        "timing.shifted_cameras:ShiftedOffsets",
        "clocks from motion on a recording whose cameras are shifted",
    ),
    "patches": (
        "surface.patches:Patches",
        "motion of the surface: time of every stage by the number of views",
    ),
    "recording": (
        "live.recording:RecorderMemory",
        "memory of a live run that records, with hours simulated in minutes",
    ),
    "refine": (
        "surface.refine:RefinementStudy",
        "effect of the motion of the surface, on a capture with truth",
    ),
    "refine-faults": (
        "surface.refine_faults:RefineFaults",
        "refinement by every method of true joints with noise, outliers and gaps",
    ),
    "resolution": (
        "rigs.resolution:Resolution",
        "accuracy of HD, VGA and QVGA cameras, rendered",
    ),
    "soak": (
        "live.soak:Soak",
        "a long live run in which cameras fail and return and processes are killed",
    ),
    "solve": (
        "fusion.solve:SolveStudy",
        "2D people to skeletons: time of every stage on one thread, and joints with large errors",
    ),
    "sound": (
        "timing.sound:Sound",
        "clocks from sound in simulated rooms against the truth, and controls",
    ),
    "sound-motion": (
        "timing.sound:SoundMotion",
        "clocks from sound, and from motion after it, against the truth",
    ),
    "stage1": (
        "stage1.stage1:Stage1",
        "voting, assembly, tracking and refinement beside baselines: time, memory, accuracy",
    ),
    "start": (
        "start:Start",
        "duration of each command in seconds",
    ),
    "steady": (
        "surface.steady:SteadinessStudy",
        "limb lengths and accelerations of a capture without truth, without and with patches",
    ),
    "terms": (
        "bodies.terms:Terms",
        "each term of the kinematic solve left out (Malleson et al. 2020, Table 3)",
    ),
    "time": (
        "rigs.times:Time",
        "seconds for a minute of capture (Joo et al. 2017, Table 2)",
    ),
    "view": (
        "live.view:View",
        "viewer of a live graph: its load, ages of data, effects of slow and frozen pages",
    ),
    "view-recording": (
        "live.view:ViewRecording",
        "viewer of a recording: seconds to open it and to seek",
    ),
    "visibility": (
        "fusion.visibility:Visibility",
        "effect of known occluders and depth maps on votes, nodes and people",
    ),
    "walkout": (
        "people.walk_out:Walkout",
        "people seen by two cameras and then by one, in a capture or simulated",
    ),
}
PRINTED = Path("-")  # value of --json without a file name: print JSON


def study_of(name: str) -> type[Study]:
    """Return the class of a study.

    Raises:
        UsageError: if no study has this name.
    """
    if name not in STUDIES:
        raise UsageError(f"there is no study {name!r}; {nearest(name, STUDIES)}")
    module, _, kind = STUDIES[name][0].partition(":")
    found: type[Study] = getattr(importlib.import_module(f"panoptic_ros.study.{module}"), kind)
    return found


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        """See `argparse`."""
        raise UsageError(f"{message}; see `{self.prog} --help`")


def parsed(name: str, words: Sequence[str]) -> Study:
    """Return the study of this name with its parsed options.

    Raises:
        UsageError: on an unknown name, an unknown option or an invalid value.
    """
    kind, about = study_of(name), STUDIES[name][1]
    parser = _Parser(
        prog=f"panoptic study {name}", description=f"{about[0].upper()}{about[1:]}.", allow_abbrev=False
    )
    kind.add_options(parser)
    parser.add_argument(
        "--json",
        type=_output,
        nargs="?",
        const=PRINTED,
        metavar="FILE",
        help="write JSON into FILE; without FILE, print JSON instead of the table",
    )
    if kind.has_plot:
        parser.add_argument("--plot", type=output_file, metavar="FILE.png", help="plot the result into FILE")
    return kind(name, parser.parse_args(list(words)), _of_the_work(words))


def _of_the_work(words: Sequence[str]) -> list[str]:
    """Return the words without --json, --plot and their file names."""
    found, skipped = [], False
    for word in words:
        of_output = word.partition("=")[0] in ("--json", "--plot")
        if not of_output and (not skipped or word.startswith("--")):
            found.append(word)
        skipped = of_output and "=" not in word
    return found


def _output(text: str) -> Path:
    """Return the path of the output file, or `PRINTED` for "-"."""
    return PRINTED if text == str(PRINTED) else output_file(text)
