"""Builds from the request to the files in `out/`, as called by `dxb build`, `dxb watch` and `Project.build`."""
