"""ROS 2 recordings: messages in CDR, and MCAP files of them."""
