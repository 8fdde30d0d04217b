"""Objects, from their pixels to simulation-ready assets."""
