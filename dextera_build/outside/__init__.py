"""Backends in processes of their own: their protocol, environments and limits."""
