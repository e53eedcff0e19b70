"""One box for everything that has a name: pads, drones, sessions, transactions, blocks."""
