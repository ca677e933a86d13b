"""The text line with which a session shares its selection."""

from s2rtui.session.session import Session
from s2rtui.session.shared_selection import current_selection, shared_text


def shared_line(session: Session) -> str:
    """The text that a user of the session copies."""
    return shared_text(current_selection(session.state), session.store.dataset.hash)
