"""Task runtime: starts, steps, recording, replay."""
