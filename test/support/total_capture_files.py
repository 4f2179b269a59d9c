"""A simulated body written as Total Capture comes: text files, inches, y up, other axes of bones."""

import numpy as np

from panoptic_ros.geometry.rotations import from_quaternions, rotations_of, to_quaternions
from panoptic_ros.io.datasets.total_capture import SEGMENTS, WORN
from panoptic_ros.io.rigs.total_capture import Z_UP

OUR_AXES = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # from theirs, of a segment
FIRST_ROW, FIRST_COLUMN = 2, 3


def numbers(values):
    return " ".join(f"{value:.12g}" for value in values)


def calibration_lines(rig):
    """As calibration.cal, whose images are cut out of larger ones."""
    lines = [f"{len(rig)} 1"]
    for camera in rig.cameras:
        (width, height), matrix, pose = camera.image_size, camera.intrinsics.matrix, camera.cam_from_world
        lines.append(f"{FIRST_ROW} {FIRST_ROW + height - 1} {FIRST_COLUMN} {FIRST_COLUMN + width - 1}")
        centre = (matrix[0, 2] + FIRST_COLUMN, matrix[1, 2] + FIRST_ROW)
        lines.append(numbers([matrix[0, 0], matrix[1, 1], *centre]))
        lines.append(numbers(camera.intrinsics.distortion[:1]))
        lines += [numbers(row) for row in pose.rotation @ Z_UP]
        lines.append(numbers(pose.translation))
    return lines


def skeleton_lines(model, truth):
    """Lines of places and of orientations, with clavicles and without toes."""
    names = [*SEGMENTS, "RightShoulder", "LeftShoulder"]
    places, turns = ["\t".join(names) + "\t"], ["\t".join(names) + "\t"]
    for state in truth:
        own = [model.index(segment) for segment in SEGMENTS.values()]
        chest, arms = model.index("spine4"), [model.index(name) for name in ("rUpperArm", "lUpperArm")]
        joints = [*state.places[own], *(0.5 * (state.places[chest] + state.places[arm]) for arm in arms)]
        frames = Z_UP.T @ state.frames[[*own, chest, chest]] @ OUR_AXES
        places.append("\t".join(numbers(Z_UP.T @ place / 0.0254) for place in joints))
        turns.append("\t".join(numbers(turn[[1, 2, 3, 0]]) for turn in to_quaternions(frames)))
    return places, turns


def sensor_lines(subject, model, devices, rng, width=13):
    """Lines of samples, of bones and of references; every sensor has an inertial frame of its own."""
    segments = {segment: name for name, segment in WORN.items()}
    names = {device.name: segments[model.names[device.segment]] for device in subject.devices}
    worlds = {name: rotations_of(rng.normal(size=(1, 3)))[0] for name in names}
    count = min(len(devices[name].stamps) for name in names)
    lines = [f"{len(names)}\t{count}"]
    turns = {
        name: to_quaternions(worlds[name].T @ Z_UP.T @ from_quaternions(devices[name].quaternions))
        for name in names
    }
    for t in range(count):
        lines.append(str(t + 1))
        for name, theirs in names.items():
            row = [*turns[name][t], *devices[name].forces[t], *devices[name].rates[t], 0.1, 0.2, 0.3]
            lines.append("\t".join([theirs, *(f"{value:.12g}" for value in row[:width])]) + "\t")
    bone, reference = [str(len(names))], [str(len(names))]
    for device in subject.devices:
        for told, turn in ((bone, OUR_AXES.T @ device.mount), (reference, worlds[device.name])):
            told.append(f"{names[device.name]} {numbers(to_quaternions(turn)[[1, 2, 3, 0]])}")
    return lines, bone, reference


def write_take(folder, take, model, width=13):
    """A take s1/acting1 of a simulated body, in the folders of the data set."""
    rng = np.random.default_rng(5)
    samples, bone, reference = sensor_lines(take.subject, model, take.devices, rng, width)
    places, turns = skeleton_lines(model, take.truth())
    files = {
        "calibration.cal": calibration_lines(take.rig),
        "s1_Gyro_Mag/Acting1_Xsens_AuxFields.sensors": samples,
        "s1/s1_acting1_calib_imu_bone.txt": bone,
        "s1/s1_acting1_calib_imu_ref.txt": reference,
        "S1/acting1/gt_skel_gbl_pos.txt": places,
        "S1/acting1/gt_skel_gbl_ori.txt": turns,
        "S1/acting2/gt_skel_gbl_pos.txt": ["of another take"],
    }
    for name, lines in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("\n".join(lines) + "\n")
    (folder / "S1" / "video").mkdir(parents=True)
    (folder / "S1" / "video" / "TC_S1_acting1_cam2.mp4").write_bytes(b"a video")
