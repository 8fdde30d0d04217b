"""Many worlds of a task whose states, observations, verdicts and rewards are tensors on one device."""
