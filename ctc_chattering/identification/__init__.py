"""Friction, delays and model errors from recorded motions."""
