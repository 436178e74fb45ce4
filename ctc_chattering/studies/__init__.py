"""Many runs: studies and comparisons."""
