"""Stores on other machines: a folder, a server or a bucket that several builders share."""
