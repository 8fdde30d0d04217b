"""Records of builds: events, logs, the history of nodes, and the snapshot for no-op builds."""
