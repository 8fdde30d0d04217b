"""Networks and their weights, for the interface of `dextera_build.policy`."""
