"""Recorded motions of a robot, real or simulated, and the commands that it was given."""

from s2rtools.motion_logs.drives import read_drives
from s2rtools.motion_logs.motion_log import Commands, Drive, Log
from s2rtools.motion_logs.readers import READERS, read

__all__ = ["READERS", "Commands", "Drive", "Log", "read", "read_drives"]
