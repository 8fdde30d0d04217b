"""Pure functions on arrays: SE(3), Sim(3), cameras, registration, sampling, metrics."""
