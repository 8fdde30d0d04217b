"""What many worlds cost in one process, beside MuJoCo alone."""
