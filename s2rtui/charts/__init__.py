"""The views: each folder holds a view, its numbers, and its drawings for terminal and paper."""
