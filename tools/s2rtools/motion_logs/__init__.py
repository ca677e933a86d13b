"""Recorded motions of a robot, real or simulated, and the commands that it was given."""

from s2rtools.motion_logs.drives import READERS, read, read_drives
from s2rtools.motion_logs.motion_log import Commands, Drive, Log

__all__ = ["READERS", "Commands", "Drive", "Log", "read", "read_drives"]
