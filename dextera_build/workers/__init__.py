"""Execution of nodes: worker processes, Ray, and the resources of machines."""
