"""Check the conventions of poses and depth on back-projected depth images."""
