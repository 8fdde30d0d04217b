"""Networks and their weights, behind the interface of `dextera_build.policy`."""
