"""Discovered inputs: questions about the project's folder, their answers, and the results that they lead to."""
