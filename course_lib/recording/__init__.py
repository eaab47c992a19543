"""Recorded experiments: what a world writes and a replay reads, and readers of public recordings of real robots."""

from course_lib.recording.ground import GroundRecording
from course_lib.recording.mrclam import read_mrclam
from course_lib.recording.run import Run, replay
from course_lib.recording.text import RecordingError
from course_lib.recording.uwb import read_uwb

__all__ = ["GroundRecording", "RecordingError", "Run", "read_mrclam", "read_uwb", "replay"]
