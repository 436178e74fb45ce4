"""Figures, tables and page of a map."""
