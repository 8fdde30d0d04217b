"""Where nodes run: worker processes, Ray, and what a machine has to share out."""
