"""Files of the user: saved selections, notes, tags."""
