"""dxb: a content-addressed build system for robot digital twins."""

__version__ = "0.1.0"
