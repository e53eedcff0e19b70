"""Those who lie. Spoofers of GNSS are in ``wonderland_simulator.gnss``; here are the ones who work on the radio."""
