"""The wire of ROS 1: XML-RPC to the master and between nodes, TCPROS for messages. Nothing of ROS is installed."""
