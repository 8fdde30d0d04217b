"""Calls of services: recorded, and answered again from the record."""
