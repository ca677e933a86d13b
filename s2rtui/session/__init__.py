"""The analysis session: plain Python, one frozen state per change; knows no screen."""

from s2rtui.session.session import Session
from s2rtui.session.state import HeatChoice, State

__all__ = ["HeatChoice", "Session", "State"]
