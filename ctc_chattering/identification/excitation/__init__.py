"""Motions that excite all joints of a robot."""
