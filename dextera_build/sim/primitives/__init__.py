"""Task primitives: a folder each, shared code, the common judge, and grasp estimation."""
