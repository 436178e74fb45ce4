"""Parameter files and what they name."""
