"""The one policy interface: spaces, normalisation, checkpoint contract."""
