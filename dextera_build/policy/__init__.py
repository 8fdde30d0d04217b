"""The one interface of policies: what they see, the contract of a checkpoint, how they run. Knows no simulator."""
