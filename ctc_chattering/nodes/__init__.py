"""The ROS 2 nodes: each callback turns a message into arrays, calls the core once, publishes."""
