"""ROS 2 by the wire of rmw_zenoh: a pad as a node. What a peer of ROS says here permits nothing."""
