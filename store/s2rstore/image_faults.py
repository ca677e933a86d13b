"""The faults that `s2r check` finds in recorded images, and their limits."""

from __future__ import annotations

import math

BLURRED = 0.5
"""Sharpness in the median of the neighbours below which an image is blurred."""
DARK, BRIGHT = 0.7, 0.4
"""Shares of black and of white pixels from which an image is badly exposed."""
STILL = 0.15
"""Mean change of grey values (0 .. 255) below which an image equals the one before."""
MOVED = 0.05, math.radians(2)
"""Metres and radians between poses from which two images must differ."""
SAME_POSE = 0.01, math.radians(0.5)
"""Metres and radians between poses below which two images show the same for a reason."""
ALIKE = 3
"""Differing bits of each half of 64 up to which two images show the same."""
FAR = 2.0
"""Metres between poses from which images that show the same contradict the poses."""
MISPAIRED = 0.5, 0.15
"""Similarity in the median of all pairs below which a pair is doubted, and by how much the image of
another place must be more similar."""
HOLES, SATURATED = 0.6, 0.3
"""Shares of pixels without depth, and of depth at the end of its range."""
TIME_JUMP, POSE_JUMP = 5.0, 4.0
"""Steps, in the median step of time and in the 90th percentile of distance, that are jumps."""
SMALLEST_JUMP = 0.5
"""Metres below which no step is a jump."""

FAULTS: dict[str, str] = {
    "blurred": f"sharpness below {BLURRED:g} of that of the neighbours",
    "dark": f"{DARK:.0%} of the pixels or more are black",
    "bright": f"{BRIGHT:.0%} of the pixels or more are white",
    "frozen": "equals the image before although the pose changed",
    "repeated": "the same image as at another pose",
    "misplaced": f"shows the same as an image {FAR:g} m away or more",
    "mispaired": "the sim image fits a real image of another place better",
    "duplicate": f"shows the same as an earlier image within {SAME_POSE[0] * 100:g} cm",
    "leaked": f"evaluated, and nearly the same as a training image within {MOVED[0] * 100:g} cm",
    "depth_holes": f"{HOLES:.0%} of the pixels or more have no valid depth",
    "depth_saturated": f"{SATURATED:.0%} of the depth or more is at the end of its range",
    "time_jump": "time stands still, goes back, or leaves out five steps",
    "pose_jump": f"{POSE_JUMP:g} times as far from the pose before as nine of ten others",
}
"""Meaning of each fault, by the name that `health:NAME` selects."""
