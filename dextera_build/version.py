"""The version of dxb, in a module that every layer may import."""

__version__ = "0.1.0"
