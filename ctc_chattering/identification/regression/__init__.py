"""Friction, delays and errors of the model from recorded runs."""
