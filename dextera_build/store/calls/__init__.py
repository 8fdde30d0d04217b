"""Recorded calls: what a service answered to a request, kept under the digest of the request."""
