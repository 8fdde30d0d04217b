"""Task primitives: one file each with its success and its reward, the judge of all, and the hold of a hand."""
