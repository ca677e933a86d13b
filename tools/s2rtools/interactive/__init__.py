"""One model at hand: what it says of an instance while its images are being adjusted."""

from s2rtools.interactive.live_model import LiveModel
from s2rtools.interactive.live_result import LiveResult, LiveSide

__all__ = ["LiveModel", "LiveResult", "LiveSide"]
