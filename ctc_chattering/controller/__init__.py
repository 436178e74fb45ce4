"""Whether a joint state may be answered, and with what torque: the loop, without ROS."""
