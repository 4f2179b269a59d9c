"""What the kinematics stage tells."""

from __future__ import annotations

from panoptic_ros.stage import Notice

ODD = "kinematics.odd_stamp"


def unworn(device: str) -> Notice:
    """Samples of a device come that nobody wears."""
    text = f"{device} is on no subject; it is left out"
    return Notice("kinematics.imu_unknown", "warning", text, {"device": device})


def odd_stamp(stamp_ns: int, name: str, warns: bool) -> Notice:
    """A stamp is far from those of others."""
    text = f"the stamp {stamp_ns} of {name} is more than 2 s off the others; it is left out"
    return Notice(ODD, "warning" if warns else "info", text, {"device": name})


def jump(stamp_ns: int, name: str) -> Notice:
    """Time goes on elsewhere."""
    text = f"stamps go on from {stamp_ns}, as {name} and others say; bodies begin anew"
    return Notice("kinematics.jump", "warning", text)


def late(left_out: int, waited_ns: int) -> Notice:
    """Instants were left out, as data had waited for so long."""
    text = (
        f"{left_out} instants were left out, as data had waited for {1e-6 * waited_ns:.0f} ms: this machine "
        "is too slow, or others use it; give fewer subjects or a lower `rate_hz`"
    )
    return Notice("kinematics.late", "warning", text, {"left_out": left_out})


def never_came(number: int, seconds: float) -> Notice:
    """Somebody was not seen so long."""
    text = (
        f"subject {number} has not come in {seconds:g} s: no camera has seen it and no IMU that is "
        "mounted tells of it; look at `start`, `id` and the devices of its file"
    )
    return Notice("kinematics.never_came", "warning", text, {"device": f"subject {number}"})
