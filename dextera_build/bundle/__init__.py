"""Bundles: targets with everything that explains them, as a signed OCI image layout."""
