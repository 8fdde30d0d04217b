"""Tasks as environments for reinforcement learning."""
