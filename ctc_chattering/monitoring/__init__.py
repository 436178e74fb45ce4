"""What is watched while the nodes run, without ROS: publishers, silence, rates, states."""
