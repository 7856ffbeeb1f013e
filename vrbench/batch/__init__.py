"""Many runs at once: units of work, processes and places that are shared."""
