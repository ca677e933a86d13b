"""Label images: which object each pixel of a frame shows."""
