"""Tasks, episodes, trials and policies."""
