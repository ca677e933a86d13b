"""Does translation spare the calibration of a line detector: renderer, detector and study."""
