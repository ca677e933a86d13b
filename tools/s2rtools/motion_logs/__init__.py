"""Motion logs of real and simulated robots, and the commands that they executed."""

from s2rtools.motion_logs.drives import READERS, read, read_drives
from s2rtools.motion_logs.motion_log import Commands, Drive, Log

__all__ = ["READERS", "Commands", "Drive", "Log", "read", "read_drives"]
