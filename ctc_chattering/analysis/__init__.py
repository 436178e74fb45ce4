"""From a run to numbers, figures and pages."""
