"""The build engine: keys, states, scheduling. Knows bytes, never types; prints nothing, speaks in events."""
