"""uav_agent."""
