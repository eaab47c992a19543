"""Recorded experiments: what a world writes and a replay reads, and readers of public recordings of real robots.

Maps are read by `course_lib.recording.ros_map`, which is not imported here: no world needs its libraries.
"""

from course_lib.recording.carmen import LaserRecording, read_carmen
from course_lib.recording.ground import GroundRecording
from course_lib.recording.mrclam import read_mrclam
from course_lib.recording.run import Run, replay
from course_lib.recording.text import RecordingError
from course_lib.recording.uwb import read_uwb

__all__ = [
    "GroundRecording",
    "LaserRecording",
    "RecordingError",
    "Run",
    "read_carmen",
    "read_mrclam",
    "read_uwb",
    "replay",
]
