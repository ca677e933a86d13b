"""Line detection on road images by colour thresholds, tuning of the thresholds, translation."""
