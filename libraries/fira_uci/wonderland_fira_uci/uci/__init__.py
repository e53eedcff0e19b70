"""FiRa UWB Command Interface: packets, configuration, sessions, ranging, data, and the host-side state machine."""
