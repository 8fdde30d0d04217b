"""The program that trains policies of dxb and of other projects on the same data."""
