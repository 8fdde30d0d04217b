"""Task primitives: one file each with success condition and reward, the common judge, and grasp estimation."""
