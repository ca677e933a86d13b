"""ROS bags as recordings: messages in random access, their images, topics and transforms."""
