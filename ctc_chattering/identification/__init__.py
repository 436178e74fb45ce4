"""From a recorded run to friction, delays, model errors and gains."""
