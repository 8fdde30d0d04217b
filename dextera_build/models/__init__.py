"""Weights of pretrained models: descriptions, installed versions, licences."""
