"""What depends on ROS 2 and is shared by the nodes."""
