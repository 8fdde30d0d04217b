"""Weights of pretrained models: what is described, what is installed, and under which licence."""
