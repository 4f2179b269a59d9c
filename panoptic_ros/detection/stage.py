"""Detection stage: from images to 2D poses and score maps in the joints of the working skeleton."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np

from panoptic_ros.detection import region_maps, resemblance, score_maps
from panoptic_ros.detection.allowance import Allowance
from panoptic_ros.detection.budget import FEW, Budget, DetectionPace, Processor
from panoptic_ros.detection.card import CROP_FAMILIES
from panoptic_ros.detection.config import DetectionConfig, with_card_thresholds
from panoptic_ros.detection.crops import CropNetwork
from panoptic_ros.detection.decoders import center_heads
from panoptic_ros.detection.flow import FlowReference
from panoptic_ros.detection.full_image import FullImageNetwork, ImageDetections
from panoptic_ros.detection.input_size import SURE, InputSizeChooser, InputSizeResult
from panoptic_ros.detection.looking import CameraSchedule, IgnoredAlarm
from panoptic_ros.detection.model import DetectorModel
from panoptic_ros.detection.people import DetectedPeople, boxes_of_points
from panoptic_ros.detection.preprocess import ImageRotation, composed, turn_by
from panoptic_ros.detection.upright import rolls_of
from panoptic_ros.detection.watching import RigDetector
from panoptic_ros.domain import (
    NO_CAMERAS,
    DepthFrame,
    JointMap,
    TrackSet,
    ViewDetections,
    ViewFrame,
    VisibilityLimit,
)
from panoptic_ros.errors import ContractError, DataError
from panoptic_ros.stage import Notice, StageContext, StepResult
from panoptic_ros.state import Stateful, StateLayout

Array = np.ndarray
DEPTHS = 8  # greatest number of depth maps of a camera that wait, while its images fail
MARGIN = 1.1  # factor by which people may leave the good range of heights without a notice
PATIENCE = 15  # frames with people who are too small or too large before the notice
SAME_NS = 8_000_000  # greatest difference of timestamps between an image and its depth map
SMALL = 0.57  # side of a small whole image / usual side: less precise, same detection rate, third of the cost
UNCLAIMED_PEAK = 0.3  # least map peak without a person that counts


class DetectionStage(Stateful):
    """Stage that detects people in the images of any number of cameras, each camera on its own.

    Images of cameras on their side or upside down are rotated upright for the network. Records are in px of
    the cameras.

    `context.extras` holds "detector", a DetectorModel, and "joint_map", the JointMap from its joints to those
    of the context's skeleton. In live runs it also holds "processor", a Processor. The stage uses it to stay
    within `budget`. Its presence marks a live run, where looks must not delay images. Images of different
    cameras, and tracks, may be stepped through concurrently.

    Raises:
        BackendError: if the network cannot run here or differs from its card.
    """

    LAYOUT = StateLayout(
        "detection",
        (
            "_sides",
            "_outside",
            "_noticed",
            "_depths",
            "_said_up",
            "_watch.memories",
            "_watch.known.tracks",
            "_watch.known.places",
            "_watch.known.doors",
            "_watch.known.begin_ns",
            "_watch.lookout.cameras",
            "_watch.lookout.alarm_ns",
            "_watch.lookout.ignored",
        ),
        (InputSizeChooser, DepthFrame, FlowReference, DetectedPeople, TrackSet, CameraSchedule, IgnoredAlarm),
        same={"configuration": "config", "model": "model_name", "skeleton": "skeleton_hash"},
    )

    def __init__(self, config: DetectionConfig, context: StageContext):
        model = context.extras.get("detector")
        joint_map = context.extras.get("joint_map")
        if not isinstance(model, DetectorModel) or not isinstance(joint_map, JointMap):
            raise ContractError("detection needs extras 'detector' and 'joint_map'")
        if joint_map.source_count != len(model.card.joints):
            raise ContractError(
                f"the joint map is for {joint_map.source_count} joints, "
                f"model {model.card.name} has {len(model.card.joints)}"
            )
        self.config = with_card_thresholds(config, model.card)
        self.model_name = model.card.name
        self.skeleton_hash = context.skeleton.hash
        self.joint_map = joint_map
        self.network: CropNetwork | FullImageNetwork
        if model.card.family in CROP_FAMILIES:
            self.network = CropNetwork(model, config)
        else:
            self.network = FullImageNetwork(model, config)
        warm_up()
        self._rolls = rolls_of(context.rig or NO_CAMERAS, config.up)
        self._enlarged = {  # by the rotation; inputs grow by this factor, to keep the height of people
            name: turn_by(degrees, context.rig.camera(name).image_size).enlarged
            for name, degrees in self._rolls.degrees.items()
        }
        self._said_up = False
        self._sides: dict[str, InputSizeChooser] = {}
        self._outside: dict[str, int] = {}
        self._noticed: set[str] = set()
        self._depths: dict[str, deque[DepthFrame]] = {}
        processor = context.extras.get("processor")
        live = isinstance(processor, Processor)
        self._hurried = live and config.rationed
        self._watch: RigDetector | None = None  # None: the network runs on the whole of every image
        if config.guided or config.rationed:
            self._watch = RigDetector(
                self.config,
                self.network,
                context.rig,
                self._rolls.degrees,
                joint_map,
                self._whole,
                lambda item: self._chooser(item).now,
                Allowance(len(context.rig)) if self._hurried else None,
            )
        self._budget: tuple[Budget, Processor] | None = None
        if config.budget and isinstance(processor, Processor):
            begin = DetectionPace(config.looks_per_s or FEW, config.region_height)
            budget = Budget(config.budget, processor.cores, config.region_height, begin)
            self._budget = budget, processor

    def step(self, item: ViewFrame | DepthFrame | TrackSet) -> StepResult[ViewDetections]:
        """Detect the people in one image, or accept a depth map or tracks.

        A depth map must come before the image of its timestamp.

        Raises:
            DataError: if the depth map of an image has another shape (the next image goes without it), or if
                tracks have another skeleton.
        """
        if isinstance(item, DepthFrame):
            self._depths.setdefault(item.camera, deque(maxlen=DEPTHS)).append(item)
            return StepResult()
        if isinstance(item, TrackSet):
            joints = len(self.joint_map.sources)
            if item.skeleton_hash != self.skeleton_hash or item.ages.shape[1] != joints:
                raise DataError(
                    f"tracks of skeleton {item.skeleton_hash} with {item.ages.shape[1]} joints, but "
                    f"detection works on {self.skeleton_hash} with {joints}; configure one for all"
                )
            if self._watch is not None:
                self._watch.take(item)
            return StepResult()
        limit = self._limit(item)
        start = 0.0 if self._budget is None else self._budget[1].thread_s()
        turn, upright = self._upright(item)
        told: tuple[Notice, ...] = ()
        if self._watch is None:
            finding, carried = self._whole(upright), None
        else:
            finding, carried = self._watch.find(upright)
            told = self._paced(item, self._watch, finding, start)
        record = self._record(item, finding if turn is None else _back(finding, turn), limit, carried)
        return StepResult((record,), (*self._up_notice(), *told, *self._size_notice(item.camera, finding)))

    def _upright(self, item: ViewFrame) -> tuple[ImageRotation | None, ViewFrame]:
        """Rotate an image upright; return None and the image itself if it is upright already."""
        degrees = self._rolls.degrees.get(item.camera)
        if degrees is None:
            return None, item
        turn = turn_by(degrees, item.image_size)
        return turn, replace(item, image=turn.image(item.image, self.network.card.input.pad))

    def _up_notice(self) -> tuple[Notice, ...]:
        """Return the notice about rotated images, or about why none is rotated, on the first call only."""
        if self._said_up or self._rolls.notice is None:
            return ()
        self._said_up = True
        return (self._rolls.notice,)

    def _paced(
        self, item: ViewFrame, watch: RigDetector, finding: ImageDetections, start: float
    ) -> tuple[Notice, ...]:
        """Report the cost of an image, and apply the new pace if the budget changes it.

        Args:
            start: Processor time of the thread, s, before the image.
        """
        if self._budget is None:
            return ()
        budget, processor = self._budget
        spent = processor.thread_s() - start
        chosen = budget.took(item.camera, item.stamp_ns, item.frame_number, finding.scale > 0.0, spent)
        if chosen is None:
            return ()
        watch.keep(chosen)
        often = f"{chosen.looks_per_s:.1f} looks per s" if chosen.looks_per_s else "a look at every image"
        used = budget.used()
        text = (
            f"{often} of each camera, people up to {chosen.region_height} px: {used:.2f} of "
            f"{processor.cores} cores, {self.config.budget * processor.cores:.2f} allowed"
        )
        values = {"looks_per_s": chosen.looks_per_s, "region_height": chosen.region_height, "cores": used}
        return (Notice("detection.pace", "info", text, values),)

    def _whole(self, item: ViewFrame) -> ImageDetections:
        """Detect the people in the whole image, at the input size that suits its camera."""
        if not self.network.any_size:
            return self.network.find(item.image, 0)
        chooser = self._chooser(item)
        sides = chooser.plan()
        if self._hurried and len(sides) == 1:
            return self._small(item, chooser, sides[0])
        findings = [self.network.find(item.image, side) for side in sides]
        answers = [self._answer(finding, side) for finding, side in zip(findings, sides)]
        return findings[chooser.learn(answers, max(item.image_size))]

    def _small(self, item: ViewFrame, chooser: InputSizeChooser, side: int) -> ImageDetections:
        """Detect the people in a smaller whole image: enough to find them, in live runs with few looks."""
        multiple = self.network.multiple
        finding = self.network.find(item.image, multiple * max(round(SMALL * side / multiple), 1))
        chooser.saw(self._answer(finding, side), max(item.image_size))
        return finding

    def flush(self) -> StepResult[ViewDetections]:
        """Reset the stage; it buffers no records."""
        self.reset()
        return StepResult()

    def reset(self) -> None:
        """Forget people's sizes, waiting depth maps, notices, and the state of guided detection."""
        self._sides.clear()
        self._outside.clear()
        self._noticed.clear()
        self._said_up = False
        self._depths.clear()
        if self._watch is not None:
            self._watch.reset()

    def _chooser(self, item: ViewFrame) -> InputSizeChooser:
        if item.camera not in self._sides:
            config, multiple = self.config, self.network.multiple
            enlarged = self._enlarged.get(item.camera, 1.0)
            largest = min(round(enlarged * config.largest_input), max(item.image_size))
            self._sides[item.camera] = InputSizeChooser(
                start=round(enlarged * config.input_side),
                least=config.smallest_input,
                most=max(config.smallest_input, largest),
                multiple=multiple,
                adaptive=config.adapt_input,
            )
        return self._sides[item.camera]

    def _answer(self, finding: ImageDetections, side: int) -> InputSizeResult:
        unclaimed = finding.patches.unclaimed_joints(UNCLAIMED_PEAK) if finding.patches else 0
        return InputSizeResult(side, finding.people.person_scores, self._heights(finding), unclaimed)

    def _heights(self, finding: ImageDetections) -> Array:
        """Return the longer side (P,) of the box round the seen joints, image px."""
        people = finding.people
        boxes = boxes_of_points(people.points, people.scores >= self.config.joint_threshold)
        sizes: Array = (boxes[:, 2:] - boxes[:, :2]).max(axis=1, initial=0.0)
        return sizes

    def _record(
        self, item: ViewFrame, finding: ImageDetections, limit: VisibilityLimit | None, carried: Array | None
    ) -> ViewDetections:
        people = finding.people
        scores = np.where(people.scores >= self.config.joint_threshold, people.scores, 0.0)
        points, scores = self.joint_map.apply(people.points, scores)
        return ViewDetections(
            camera=item.camera,
            stamp_ns=item.stamp_ns,
            frame_number=item.frame_number,
            image_size=item.image_size,
            skeleton_hash=self.skeleton_hash,
            points=points,
            scores=scores,
            person_scores=people.person_scores,
            maps=finding.patches.score_maps(self.joint_map) if finding.patches else None,
            limit=limit,
            carried=carried,
        )

    def _limit(self, item: ViewFrame) -> VisibilityLimit | None:
        """Return the visibility limit of the camera, if it measures depth."""
        found = self._depth_of(item)
        if found is None:
            return None
        found.check_image(item.image_size)
        return VisibilityLimit.of_depths(found.depth, self.config.depth_margin)

    def _depth_of(self, item: ViewFrame) -> DepthFrame | None:
        """Remove and return the first depth map that belongs to an image; drop those before it."""
        depths = self._depths.get(item.camera, ())
        while depths and depths[0].stamp_ns < item.stamp_ns - SAME_NS:
            depths.popleft()
        if depths and depths[0].stamp_ns <= item.stamp_ns + SAME_NS:
            return depths.popleft()
        return None

    def _size_notice(self, camera: str, finding: ImageDetections) -> tuple[Notice, ...]:
        """Return a notice when people stay too small or too large for the network, once each time."""
        sure = finding.people.person_scores >= SURE
        if not finding.scale or not sure.any():
            return ()
        heights = self._heights(finding)[sure] * finding.scale
        smallest, largest = self.network.person_px
        outside = bool(((heights < smallest / MARGIN) | (heights > largest * MARGIN)).any())
        count = self._outside.get(camera, 0)
        # The count rises up to the notice while people are outside the range, and falls while they are
        # inside.
        self._outside[camera] = min(count + 1, PATIENCE) if outside else max(count - 1, 0)
        if not outside or count != PATIENCE - 1 or camera in self._noticed:
            if self._outside[camera] == 0:
                self._noticed.discard(camera)
            return ()
        self._noticed.add(camera)
        text = (
            f"camera {camera}: people are {heights.min():.0f} to {heights.max():.0f} px tall in the "
            f"network's input, which works best with {smallest:.0f} to {largest:.0f} px"
        )
        values = {"camera": camera, "smallest_px": float(heights.min()), "largest_px": float(heights.max())}
        return (Notice("detection.person_size", "warning", text, values),)


def _back(finding: ImageDetections, turn: ImageRotation) -> ImageDetections:
    """Map people and score maps of an upright image back. Boxes stay, as no record holds them."""
    people, patches = finding.people, finding.patches
    people = replace(people, points=turn.back(people.points))
    if patches is not None:  # the cells stay, only their map from image px changes
        grid = composed(patches.grid_from_image, turn.upright_from_image)
        patches = replace(patches, grid_from_image=grid)
    return replace(finding, people=people, patches=patches)


def warm_up() -> None:
    """Compile all kernels of detection, for any detector and configuration.

    These are the kernels of the decoder, of the maps, and of the distances between 2D poses.
    """
    for part in (center_heads, score_maps, region_maps, resemblance):
        part.warm_up()
