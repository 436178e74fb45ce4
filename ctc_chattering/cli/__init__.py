"""Command lines: `bringup`, and `ctc` with its subcommands."""
