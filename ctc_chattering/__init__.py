"""Computed torque plus compensation plus chattering, for robot arms with friction."""

__version__ = '0.1.0'
