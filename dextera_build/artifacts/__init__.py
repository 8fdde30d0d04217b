"""Typed values that rules take and return: a small header and blobs, with shapes, dtypes, units and frames."""
