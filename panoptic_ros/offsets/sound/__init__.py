"""Sound: the clocks of cameras from what their microphones hear, without timecode (Elhayek et al. 2012, 3).

In: the sound of every device on its own clock. Out: per camera an offset and a drift with standard
deviations, as `CameraClocks`, the same as from motion. It needs no first guess: offsets of minutes are found
as well as those of milliseconds. Who knows the microphones' positions gets smaller deviations.

Limits: sound takes 3 ms for every metre, and where its sources stand is not known; that is stated. Whatever a
device has between its sound and its images is invisible to sound.
"""

from panoptic_ros.offsets.sound.heard import HeardClocks, PairHeard
from panoptic_ros.offsets.sound.passes import SoundClocks, SoundClocksConfig

__all__ = ["HeardClocks", "PairHeard", "SoundClocks", "SoundClocksConfig"]
