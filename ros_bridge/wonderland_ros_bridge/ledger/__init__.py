"""The bridge's half towards the ledger: it takes messages and gives messages, and knows no wire of ROS."""
