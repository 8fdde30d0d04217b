"""A build from the request to the files in `out/`: what `dxb build`, `dxb watch` and `Project.build` call."""
