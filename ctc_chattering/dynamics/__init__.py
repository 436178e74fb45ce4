"""Rigid-body dynamics: the terms of equation (1)."""
