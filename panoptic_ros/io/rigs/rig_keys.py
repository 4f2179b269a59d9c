"""The keys of the formats of rigs in JSON, TOML and YAML; a file with others is told, see `known_keys`."""

from __future__ import annotations

from panoptic_ros.io.known_keys import EACH, OTHERS, keys

_CAMERA = "name image_size K distortion R t type panel clock lens line_delay_us covariance"
RIG_JSON = keys(
    "format units frame_id up",
    cameras=[keys(_CAMERA)],
    depth_sensors=[keys(f"{_CAMERA} colour_camera unit_m")],
)
PANOPTIC = keys("calibDataSource", cameras=[keys("name type panel node resolution lens K distCoef R t")])
_PACKED = "name id K R t distortion distCoef distortion_model resolution image_size width height type panel"
PACK = keys(f"format unit units to_z_up {OTHERS}", cameras=[keys(f"{_PACKED} {OTHERS}")])  # of many origins

_LENS = "size matrix distortions distortion_model rotation translation fisheye"
ANIPOSELIB = {
    "metadata": keys(f"adjusted error unit up {OTHERS}"),  # any notes of the person who calibrated
    EACH: keys(f"name {_LENS} extra_dist"),
}
_CALISCOPE = "cam_id port name rotation_count error exposure grid_count ignore verified_resolutions"
CALISCOPE = keys(OTHERS, cameras={EACH: keys(f"{_CALISCOPE} {_LENS}")})

POSES = keys("frame_id", poses={EACH: keys("translation rotation")})
_MATRIX = keys("rows cols data")
CAMERA_INFO = keys(
    "image_width image_height camera_name distortion_model binning_x binning_y roi",
    camera_matrix=_MATRIX,
    distortion_coefficients=_MATRIX,
    rectification_matrix=_MATRIX,
    projection_matrix=_MATRIX,
)
