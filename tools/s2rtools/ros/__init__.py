"""ROS nodes: a proxy that translates camera images, and replay of bags."""
