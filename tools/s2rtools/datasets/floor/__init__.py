"""The floor of a data set: its plan, its plane, and poses on it."""
