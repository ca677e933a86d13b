"""The analysis session, without a user interface: each change makes a new frozen state."""
