"""Policies in other processes: openpi's protocol on web sockets, OpenVLA's on HTTP, and what `dxb serve` promises."""
