"""Files of the user, outside any store: notebooks with saved selections, notes and tags."""
