"""What follows from what was identified: gains, a parameter file, a page."""
