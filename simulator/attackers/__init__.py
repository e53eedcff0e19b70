"""Those who lie. Spoofers of GNSS are in ``simulator.gnss``; here are the ones who work on the radio."""
