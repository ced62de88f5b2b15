"""Key-points of animals and people over time and over several cameras: one path for each joint, with its covariance.

`fuse` takes what a pose estimator found, frame by frame, and gives the points that explain it best; `Stream` does so while frames come in. docs/pose.md shows
them on recordings. The program asterism-pose does it with files.
"""

from .cameras import Camera
from .pose_files import Detections, read_cameras, read_detections, write_points
from .pose_fuse import FusedPose, fuse
from .pose_networks import network_deviation
from .pose_stream import Stream, StreamedPose
from .pose_swaps import Exchanged, exchange_back, left_right_pairs

__all__ = [
    "fuse", "FusedPose", "Camera", "Detections", "read_cameras", "read_detections", "write_points", "Stream", "StreamedPose", "exchange_back", "Exchanged",
    "left_right_pairs", "network_deviation",
]
