"""Rendering of models: cameras, light, films of episodes, portraits."""
