"""Policies on robots: transports of ROS 2 messages, the cell of a robot behind them, its checks and its recordings."""
