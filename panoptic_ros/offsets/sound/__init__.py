"""Estimate the clocks of cameras from the sound of their microphones, without timecode.

The method follows Elhayek et al. 2012, 3. Input: the sound of every device on its own clock. Output: an
offset and a drift per camera with standard deviations, as `CameraClocks`. No initial guess is needed:
offsets of minutes are found as well as offsets of milliseconds. Known microphone positions reduce the
standard deviations.

Limits: sound travels 3 ms per metre, and the positions of its sources are unknown. The standard deviations
include that. A delay between the sound and the images of a device is not observable from sound.
"""

from panoptic_ros.offsets.sound.heard import PairSound, SoundClockEstimate
from panoptic_ros.offsets.sound.passes import SoundClocks, SoundClocksConfig

__all__ = ["PairSound", "SoundClockEstimate", "SoundClocks", "SoundClocksConfig"]
