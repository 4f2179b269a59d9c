"""Convert camera timestamps to master time with clock models and delays, and handle clocks that jump."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from panoptic_ros.domain import ClockModel, ViewDetections
from panoptic_ros.params import named_words
from panoptic_ros.params.named import ALL
from panoptic_ros.stage import Notice, Severity
from panoptic_ros.stamps.delays import delay_of, named_delays

SECOND = 1_000_000_000
LATEST_NS = (2**31 - 1) * SECOND  # ns; ROS messages cannot hold later timestamps
FOREVER = 2**63 - 1  # ns, `until_ns` of a model that stays valid without observations
HELD = 64  # default maximum number of frames per camera that wait for a clock
UNHEARD_S = 2.0  # s of waiting frames after which a clock without any model is reported
SILENT_S = 3.0  # s without observations of a clock, after which the clock is reported as silent
FAR_S = 600.0  # s, maximum distance of a camera's first frame from the observations of its clock
GAP_S = 0.3  # s; a longer step between frames may hide a clock jump
ODD_STEP = 0.2  # periods, maximum deviation of a frame step from whole periods
MOST_PERIODS = 2  # longest regular frame step: one frame may be dropped; a longer step may be a clock jump
PATIENCE_S = 2.0  # s of frames that wait for a new clock model after a gap
BEFORE_JUMP = "its clock jumped before its model was known"
LARGEST_DRIFT = 5e-3  # bad crystals deviate by 1e-4, and confused frame rates by 1e-3
RECENT = 9  # number of frame steps whose median is the period of a camera


@dataclass
class CameraClock:
    """Clock of one camera.

    Args:
        model: clock line of its frames; None before the first model.
        following: next clock line, after a jump of the clock; None if there is none.
        held: frames after an irregular step, which wait for a model that covers the step.
        newest: (ns) timestamp of the newest frame that is not held.
        steps: (ns) newest regular steps between frames.
        reported: True once a step back has been reported.
    """

    model: ClockModel | None = None
    following: ClockModel | None = None
    held: deque[ViewDetections] = field(default_factory=deque)
    newest: int | None = None  # timestamp of the newest frame that is not held
    steps: deque[int] = field(default_factory=lambda: deque(maxlen=RECENT))
    reported: bool = False


class StampCorrection:
    """Converter of view timestamps to master time.

    The clock of a camera can jump if it is observed (its model has a finite `until_ns`). The camera's own
    frames show a jump immediately. Their timestamps go back, or their step is not a whole number of periods,
    or it is longer than two periods. From then on, frames of the camera wait for a model with readings after
    the step. Therefore no frame gets a wrong time.

    Args:
        clocks: By camera, the name of its clock in the rig; "" = none.
        devices: Value of `sync.clocks`. Frames of its cameras wait for models of these clocks.
        delays_ms: Value of `sync.delays_ms`.
        most_held: Maximum number of frames per camera that wait for a clock.
    """

    def __init__(
        self,
        clocks: Mapping[str, str],
        devices: Sequence[str] = (),
        delays_ms: Sequence[str] = (),
        most_held: int = HELD,
    ):
        self._device = named_words("clocks", devices)
        self._delays = named_delays("delays_ms", delays_ms)
        self._clocks = dict(clocks)
        self._cameras = {name: CameraClock() for name in clocks}
        self._most_held = most_held
        # clocks with models; True once the clock has been reported as silent
        self._heard: dict[str, bool] = {}
        self._told: set[str] = set()  # clocks reported as having no model, or as far from the frames
        self._implausible: set[str] = set()  # clocks whose last model was impossible

    def _required(self, camera: str) -> str | None:
        """Return the clock whose model the frames of a camera must wait for, if any."""
        return self._device.get(camera, self._device.get(ALL))

    def _is_for(self, model: ClockModel, name: str) -> bool:
        """Return whether a model applies to a camera.

        The model of the clock named in the rig takes precedence over a model with the camera's own name.
        """
        required, known = self._required(name), self._cameras[name].model
        if required is not None:
            return model.device == required
        named = bool(self._clocks[name]) and model.device == self._clocks[name]
        return named or (model.device == name and (known is None or known.device == name))

    def clock(self, model: ClockModel) -> tuple[list[ViewDetections], tuple[Notice, ...]]:
        """Add a clock model if it is plausible; return the frames released by it, in master time."""
        if abs(model.drift) > LARGEST_DRIFT:
            return [], self._refuse(model)
        self._implausible.discard(model.device)
        released: list[ViewDetections] = []
        notices: list[Notice] = []
        self._heard[model.device] = False
        for name, camera in self._cameras.items():
            if not self._is_for(model, name):
                continue
            known = camera.model
            if known is None or known.device != model.device or known.segment == model.segment:
                camera.model = model
            elif model.segment < known.segment:  # the source of the models has restarted
                camera.model, camera.following = model, None
            else:
                camera.following = model
            released += self._release(camera, notices)
        return released, tuple(notices)

    def view(self, view: ViewDetections) -> tuple[list[ViewDetections], tuple[Notice, ...]]:
        """Add a frame; return the frames that can now be converted to master time."""
        notices: list[Notice] = []
        camera = self._cameras[view.camera]
        if camera.model is None and self._required(view.camera) is None:
            return self._moved([view], None, notices), tuple(notices)
        if camera.held or camera.model is None or self._odd(camera, view.stamp_ns):
            notices += self._hold(camera, view)
            return self._release(camera, notices), tuple(notices)
        self._switch(camera, view.stamp_ns)
        self._follow(camera, view.stamp_ns)
        notices += self._silent(camera.model, view.stamp_ns)
        return self._moved([view], camera.model, notices), tuple(notices)

    def corrects(self, name: str) -> bool:
        """Return whether a camera has a clock model or waits for one."""
        return self._cameras[name].model is not None or self._required(name) is not None

    def holds(self, name: str) -> bool:
        """Return whether frames of a camera wait for its clock."""
        return bool(self._cameras[name].held)

    def end(self, name: str) -> tuple[Notice, ...]:
        """End a camera; its waiting frames are dropped, as their time will never be known."""
        held = self._cameras[name].held
        lost = [_lost(view, "its clock had no observations") for view in held]
        held.clear()
        return tuple(lost)

    def _refuse(self, model: ClockModel) -> tuple[Notice, ...]:
        """Report an impossible model: a warning once, then info until a plausible model arrives."""
        told = model.device in self._implausible
        self._implausible.add(model.device)
        text = (
            f"a model of clock {model.device} is left out: its drift is {model.drift:.3g} s per second, "
            f"and at most {LARGEST_DRIFT} is possible"
        )
        severity: Severity = "info" if told else "warning"
        return (Notice("sync.clock_implausible", severity, text, {"device": model.device}),)

    # ------------------------------------------------------------------ clocks without observations

    def _unheard(self, camera: CameraClock, name: str) -> tuple[Notice, ...]:
        """Report once that frames wait for a clock without any model."""
        clock = self._required(name)
        if camera.model is not None or clock is None or clock in self._told:
            return ()
        steps = [later.stamp_ns - view.stamp_ns for view, later in pairwise(camera.held)]
        if sum(step for step in steps if 0 < step <= GAP_S * SECOND) < UNHEARD_S * SECOND:
            return ()
        self._told.add(clock)
        heard = ", ".join(sorted(self._heard)) or "none"
        text = (
            f"clock {clock} has no observations: frames of camera {name} wait for it, and are dropped "
            f"in the end; clocks with observations: {heard}"
        )
        return (Notice("sync.clock_unheard", "warning", text, {"device": clock}),)

    def _silent(self, model: ClockModel, stamp_ns: int) -> tuple[Notice, ...]:
        """Report once that a clock has not been observed for `SILENT_S`."""
        if model.until_ns == FOREVER or stamp_ns - model.until_ns < SILENT_S * SECOND:
            return ()
        if self._heard.get(model.device, True):
            return ()
        self._heard[model.device] = True
        text = f"clock {model.device} had no observations for {SILENT_S:g} s of frames; its line is held over"
        return (Notice("sync.clock_silent", "warning", text, {"device": model.device}),)

    def _is_far(self, camera: CameraClock, notices: list[Notice]) -> bool:
        """Return whether the first frames of a camera are too far from the clock's observations.

        The clock then cannot be the clock of the camera. This is reported once per clock.
        """
        model, first = camera.model, camera.held[0]
        if camera.newest is not None or model is None or model.until_ns == FOREVER:
            return False
        away = _away_s(model, first.stamp_ns)
        if away <= FAR_S:
            return False
        if model.device not in self._told:
            self._told.add(model.device)
            text = (
                f"camera {first.camera} is stamped {away:.0f} s from all observations of clock "
                f"{model.device}, and waits: are channels swapped, or is it the clock of other cameras?"
            )
            notices.append(Notice("sync.clock_far", "warning", text, {"device": model.device}))
        return True

    # ------------------------------------------------------------------ irregular steps

    def _odd(self, camera: CameraClock, stamp_ns: int) -> bool:
        """Return whether the clock may have jumped since the camera's last frame."""
        assert camera.model is not None
        if camera.model.until_ns == FOREVER:
            return False
        if camera.newest is None:
            return _away_s(camera.model, stamp_ns) > FAR_S
        step = stamp_ns - camera.newest
        if step <= 0 or step > GAP_S * SECOND:
            return True
        if len(camera.steps) < RECENT:
            return False
        ratio = step / float(np.median(camera.steps))
        return round(ratio) > MOST_PERIODS or abs(ratio - max(1, round(ratio))) > ODD_STEP

    def _hold(self, camera: CameraClock, view: ViewDetections) -> tuple[Notice, ...]:
        notices = []
        back = (camera.newest - view.stamp_ns) / SECOND if camera.newest is not None else 0.0
        if back > 0.0 and not camera.held and not camera.reported:
            text = f"stamps of camera {view.camera} went back by {back:.4g} s; frames wait for its model"
            notices.append(Notice("sync.clock_odd", "info", text, {"camera": view.camera}))
            camera.reported = True
        camera.held.append(view)
        notices += self._unheard(camera, view.camera)
        if len(camera.held) > self._most_held:
            notices.append(_lost(camera.held.popleft(), "no clock model covers its time"))
        return tuple(notices)

    def _release(self, camera: CameraClock, notices: list[Notice]) -> list[ViewDetections]:
        """Return the held frames of a camera in master time if a clock model covers the frames, else none."""
        if camera.newest is None:
            self._drop_unknown(camera, notices)
        if not camera.held or camera.model is None or self._is_far(camera, notices):
            return []
        first, last = camera.held[0].stamp_ns, camera.held[-1].stamp_ns
        forward = camera.newest is None or first > camera.newest
        following = camera.following
        if following is not None and following.from_ns <= last and following.until_ns >= first:
            camera.model, camera.following = following, None
        elif camera.newest is not None:
            heard = camera.model.until_ns >= first
            waited = last - first > PATIENCE_S * SECOND
            if not (forward and (heard or waited)):
                return []
        views = list(camera.held)
        for view in views:
            self._follow(camera, view.stamp_ns)
        camera.held.clear()
        camera.reported = False
        return self._moved(views, camera.model, notices)

    def _drop_unknown(self, camera: CameraClock, notices: list[Notice]) -> None:
        """Drop frames from before a jump that precedes the first model: their time is unknown."""
        model, held = camera.model, camera.held
        if model is None:
            return
        steps = [later.stamp_ns - view.stamp_ns for view, later in pairwise(held)]
        jumps = [k + 1 for k, step in enumerate(steps) if not 0 < step <= GAP_S * SECOND]
        lost = [held.popleft() for _ in range(jumps[-1] if jumps else 0)]
        if lost and not model.from_ns <= held[0].stamp_ns <= model.until_ns:
            # the model does not cover the jump, so the remaining frames wait
            camera.newest = lost[-1].stamp_ns
        while model.segment and held and held[0].stamp_ns < model.from_ns:
            lost.append(held.popleft())
        notices += [_lost(view, BEFORE_JUMP) for view in lost]

    # ------------------------------------------------------------------ regular steps

    def _switch(self, camera: CameraClock, stamp_ns: int) -> None:
        """Switch to the next clock line, even without an irregular step, once the current one has ended."""
        old, new = camera.model, camera.following
        if old is None or new is None or stamp_ns < new.from_ns:
            return
        if stamp_ns > old.until_ns + SECOND or new.from_ns > old.until_ns or stamp_ns < old.from_ns:
            camera.model, camera.following = new, None

    def _follow(self, camera: CameraClock, stamp_ns: int) -> None:
        if camera.newest is not None and 0 < stamp_ns - camera.newest < GAP_S * SECOND:
            camera.steps.append(stamp_ns - camera.newest)
        camera.newest = stamp_ns

    def _moved(
        self, views: Iterable[ViewDetections], model: ClockModel | None, notices: list[Notice]
    ) -> list[ViewDetections]:
        """Return frames in master time; drop frames with an impossible time: their clock model is wrong."""
        moved = []
        for view in views:
            stamp = view.stamp_ns if model is None else model.master_from_device(view.stamp_ns)[0]
            stamp = delay_of(self._delays, view.camera).corrected(stamp)
            if not 0 <= stamp < LATEST_NS:
                notices.append(_lost(view, "its clock model puts it outside of all time"))
            else:
                moved.append(view if stamp == view.stamp_ns else replace(view, stamp_ns=stamp))
        return moved


def _away_s(model: ClockModel, stamp_ns: int) -> float:
    """Return the distance (s) of a timestamp from the time span of a clock's observations.

    It is negative inside the span.
    """
    return max(stamp_ns - model.until_ns, model.from_ns - stamp_ns) / SECOND


def _lost(view: ViewDetections, why: str) -> Notice:
    text = f"frame {view.frame_number} of camera {view.camera} at {view.stamp_ns} ns was dropped: {why}"
    return Notice("sync.no_clock", "warning", text, {"camera": view.camera})
