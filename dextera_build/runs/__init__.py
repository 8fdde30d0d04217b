"""What a build leaves behind: events, logs, the history of nodes, and the snapshot of a no-op build."""
