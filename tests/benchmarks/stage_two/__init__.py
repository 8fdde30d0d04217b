"""The second stage on drawn scenes, beside programs that are not in the lock file."""
