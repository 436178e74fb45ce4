"""The numbers: models, friction, filter, laws, reference, simulation. Nothing here knows ROS."""
