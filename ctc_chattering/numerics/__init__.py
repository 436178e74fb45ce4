"""Numerical methods that know nothing of robots."""
