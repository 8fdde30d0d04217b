"""Motion of an operator's hands converted to motion of a robot's hands and palms."""
