"""The simulated robot, and the closed loop without ROS."""
