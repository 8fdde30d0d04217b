"""The build engine: keys, states, scheduling. It handles bytes, not types, and reports only through events."""
