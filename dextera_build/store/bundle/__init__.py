"""Bundles: results with all that they need, as an OCI image layout."""
