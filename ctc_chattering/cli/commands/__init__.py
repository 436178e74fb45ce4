"""
The subcommands of `ctc`, one module each.

A module has `DETAILS`, what its help says after the line that `ctc --help` shows, `add_options`,
and `run`, which returns the status. It is imported when its command is called; `run` imports what
takes time to load, or may be missing.
"""
