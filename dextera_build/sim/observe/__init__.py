"""Facts that only a simulator knows: privileged observations, contacts, progress."""
