"""The interface of policies: observations, contracts of checkpoints, execution. Independent of any simulator."""
