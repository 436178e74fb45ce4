"""Statistics of the nodes while they run, without ROS: rates, times, losses, saturation."""
