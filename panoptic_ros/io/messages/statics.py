"""What does not change with every frame as messages: rig, skeleton model, audio, timecode, clocks."""

from __future__ import annotations

import math
from fractions import Fraction
from itertools import accumulate
from typing import Any

import numpy as np

from panoptic_ros.domain import (
    AudioBlock,
    Camera,
    ClockModel,
    DepthSensor,
    FrameRate,
    Occluders,
    Rig,
    SkeletonModel,
    Timecode,
    TimecodeReading,
)
from panoptic_ros.errors import DataError
from panoptic_ros.geometry import Intrinsics, Lens, Rigid
from panoptic_ros.io.messages.arrays import flat, shaped
from panoptic_ros.io.messages.family import Messages, stamp_of


def write_skeleton_model(model: SkeletonModel, family: Messages, frame_id: str) -> Any:
    def numbers(values: Any) -> Any:
        return flat(family, np.array(list(values), np.int32), np.int32)

    return family.make(
        "SkeletonModel",
        name=model.name,
        hash=model.hash,
        joint_names=list(model.joint_names),
        root=model.root,
        head=model.head,
        bones=numbers(joint for bone in model.bones for joint in bone),
        left_right=numbers(joint for pair in model.left_right for joint in pair),
        derived_joints=numbers(joint for joint, _ in model.derived),
        derived_counts=numbers(len(sources) for _, sources in model.derived),
        derived_sources=numbers(s for _, sources in model.derived for s in sources),
        bias_floors=flat(family, np.array(model.bias_floors, np.float64), np.float64),
    )


def read_skeleton_model(message: Any) -> SkeletonModel:
    def pairs(field: str) -> tuple[tuple[int, int], ...]:
        values = getattr(message, field)
        rows = shaped(values, f"SkeletonModel.{field}", (len(values) + 1) // 2, 2)
        return tuple((int(a), int(b)) for a, b in rows)

    ends = list(accumulate(int(n) for n in message.derived_counts))
    sources = [int(s) for s in message.derived_sources]
    derived = tuple(
        (int(joint), tuple(sources[end - int(n) : end]))
        for joint, n, end in zip(message.derived_joints, message.derived_counts, ends)
    )
    return SkeletonModel(
        str(message.name),
        tuple(map(str, message.joint_names)),
        int(message.root),
        pairs("bones"),
        int(message.head),
        pairs("left_right"),
        derived,
        tuple(float(floor) for floor in message.bias_floors),
    )


def write_rig(rig: Rig, family: Messages, frame_id: str) -> Any:
    things = rig.occluders or Occluders.joined(())
    return family.make(
        "Rig",
        header=family.header(0, rig.frame_id),
        cameras=[_write_camera(camera, family) for camera in rig.cameras],
        depth_sensors=[_write_depth_sensor(sensor, family) for sensor in rig.depth_sensors],
        occluder_vertices=flat(family, things.vertices, np.float64),
        occluder_triangles=flat(family, things.triangles, np.uint32),
    )


def _write_camera(camera: Camera, family: Messages) -> Any:
    covariance = np.zeros(0) if camera.covariance is None else camera.covariance
    return family.make(
        "Camera",
        name=camera.name,
        type=camera.type,
        panel=camera.panel,
        clock=camera.clock,
        width=camera.image_size[0],
        height=camera.image_size[1],
        matrix=np.array(camera.intrinsics.matrix).reshape(9),
        lens=camera.intrinsics.lens,
        distortion=flat(family, camera.intrinsics.distortion, np.float64),
        rotation=np.array(camera.cam_from_world.rotation).reshape(9),
        translation=np.array(camera.cam_from_world.translation),
        line_delay_us=camera.line_delay_us,
        covariance=flat(family, covariance, np.float64),
    )


def _write_depth_sensor(sensor: DepthSensor, family: Messages) -> Any:
    return family.make(
        "DepthSensor",
        camera=_write_camera(sensor.camera, family),
        colour_camera=sensor.colour_camera,
        unit_m=sensor.unit_m,
    )


def _read_camera(message: Any) -> Camera:
    size = math.isqrt(len(message.covariance))
    matrix = shaped(message.matrix, "Camera.matrix", 3, 3)
    rotation = shaped(message.rotation, "Camera.rotation", 3, 3)
    return Camera(
        str(message.name),
        (int(message.width), int(message.height)),
        Intrinsics(matrix, np.asarray(message.distortion), _lens(str(message.lens))),
        Rigid(rotation, np.asarray(message.translation)),
        type=str(message.type),
        panel=str(message.panel),
        clock=str(message.clock),
        line_delay_us=float(message.line_delay_us),
        covariance=shaped(message.covariance, "Camera.covariance", size, size) if size else None,
    )


def _lens(name: str) -> Lens:
    lenses: tuple[Lens, ...] = "brown", "fisheye"
    for lens in lenses:
        if name == lens:
            return lens
    raise DataError(f"Camera.lens is {name!r}, expected 'brown' or 'fisheye'")


def _read_depth_sensor(message: Any) -> DepthSensor:
    return DepthSensor(_read_camera(message.camera), str(message.colour_camera), float(message.unit_m))


def read_rig(message: Any) -> Rig:
    things = Occluders(
        shaped(message.occluder_vertices, "Rig.occluder_vertices", len(message.occluder_vertices) // 3, 3),
        shaped(message.occluder_triangles, "Rig.occluder_triangles", len(message.occluder_triangles) // 3, 3),
    )
    return Rig(
        tuple(_read_camera(camera) for camera in message.cameras),
        str(message.header.frame_id),
        things if len(things.triangles) else None,
        tuple(_read_depth_sensor(sensor) for sensor in message.depth_sensors),
    )


def write_audio(block: AudioBlock, family: Messages, frame_id: str) -> Any:
    return family.make(
        "AudioBlock",
        header=family.header(block.stamp_ns, block.device),
        first_sample=block.first_sample,
        sample_rate=block.sample_rate,
        samples=flat(family, block.samples, np.float32),
        channels=block.samples.shape[1],
        clocks=list(block.clocks),
    )


def read_audio(message: Any) -> AudioBlock:
    channels = int(message.channels) or 1  # 0: whoever publishes one channel need not say so
    samples = np.asarray(message.samples)
    if len(samples) % channels:
        raise DataError(f"AudioBlock.samples has {len(samples)} values for {channels} channels")
    return AudioBlock(
        str(message.header.frame_id),
        stamp_of(message.header),
        int(message.first_sample),
        int(message.sample_rate),
        samples.reshape(len(samples) // channels, channels),
        tuple(str(name) for name in message.clocks),
    )


def write_timecode(reading: TimecodeReading, family: Messages, frame_id: str) -> Any:
    label = reading.timecode
    return family.make(
        "TimecodeReading",
        header=family.header(reading.stamp_ns, reading.device),
        hours=label.hours,
        minutes=label.minutes,
        seconds=label.seconds,
        frames=label.frames,
        rate_numerator=label.rate.exact.numerator,
        rate_denominator=label.rate.exact.denominator,
        drop_frame=label.rate.drop_frame,
        start_sample=reading.start_sample,
        std_samples=reading.std_samples,
        reverse=reading.reverse,
        user_bits=reading.user_bits,
        clock=reading.clock,
        sample_rate=reading.sample_rate,
    )


def read_timecode(message: Any) -> TimecodeReading:
    if not message.rate_denominator:
        raise DataError("TimecodeReading.rate_denominator is 0")
    exact = Fraction(int(message.rate_numerator), int(message.rate_denominator))
    rate = FrameRate(round(exact), exact, bool(message.drop_frame))
    hours, minutes, seconds, frames = (
        int(number) for number in (message.hours, message.minutes, message.seconds, message.frames)
    )
    label = Timecode(hours, minutes, seconds, frames, rate)
    return TimecodeReading(
        str(message.header.frame_id),
        stamp_of(message.header),
        label,
        float(message.start_sample),
        float(message.std_samples),
        bool(message.reverse),
        int(message.user_bits),
        str(message.clock),
        int(message.sample_rate),
    )


def write_clock(model: ClockModel, family: Messages, frame_id: str) -> Any:
    return family.make(
        "ClockModel",
        header=family.header(model.reference_ns, model.device),
        offset_ns=model.offset_ns,
        residual_ns=model.residual_ns,
        drift=model.drift,
        covariance=np.array(model.covariance).reshape(4),
        from_ns=model.from_ns,
        until_ns=model.until_ns,
        wander=model.wander,
        segment=model.segment,
    )


def read_clock(message: Any) -> ClockModel:
    return ClockModel(
        str(message.header.frame_id),
        stamp_of(message.header),
        int(message.offset_ns),
        float(message.drift),
        shaped(message.covariance, "ClockModel.covariance", 2, 2),
        float(message.residual_ns),
        int(message.from_ns),
        int(message.until_ns),
        float(message.wander),
        int(message.segment),
    )
