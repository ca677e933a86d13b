"""The analysis session: plain Python, one frozen state per change; knows no screen."""

from s2rtui.session.session import Session
from s2rtui.session.state import Brush, HeatChoice, State

__all__ = ["Brush", "HeatChoice", "Session", "State"]
