"""The network of `rules.factorize.regions.affinities`: pictures to learn from, training, and its file."""
