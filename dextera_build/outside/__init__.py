"""Backends in processes of their own: the protocol they speak, where they run, and what ends them."""
