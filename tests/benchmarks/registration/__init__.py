"""Objects of unknown unit and frame, placed by several methods."""
