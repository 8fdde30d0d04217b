"""Task primitives: a folder each, what they share, the common judge, and grasp estimation."""
