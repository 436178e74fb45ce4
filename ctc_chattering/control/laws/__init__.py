"""The control laws, one a module; `registry` finds them by name."""
