"""Faults of recorded images and poses: blur, exposure, frozen frames, duplicates, jumps, depth."""
