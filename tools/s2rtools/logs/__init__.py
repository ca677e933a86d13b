"""Recorded motions of a robot, real or simulated, and the commands that it was given."""

from s2rtools.logs.contract import Commands, Drive, Log

__all__ = ["Commands", "Drive", "Log"]
