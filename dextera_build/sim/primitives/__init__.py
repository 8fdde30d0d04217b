"""Task primitives: success, rewards, grasps."""
