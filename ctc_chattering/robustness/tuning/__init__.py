"""Search for gains that stand what is uncertain: `ctc tune`."""
