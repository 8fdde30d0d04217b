"""Retargeting of hands beside dex-retargeting."""
