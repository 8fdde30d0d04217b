"""Where calls run: a local pool of processes."""
