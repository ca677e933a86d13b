"""The analysis session, without a user interface: each change makes a new frozen state."""

from s2rtui.session.session import Session
from s2rtui.session.state import Brush, HeatChoice, State

__all__ = ["Brush", "HeatChoice", "Session", "State"]
