"""Stores on other machines: folders, HTTP caches, object stores; and the local store as a server."""
