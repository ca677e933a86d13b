"""Line detection on road images by colour thresholds, and whether translation spares their tuning."""
