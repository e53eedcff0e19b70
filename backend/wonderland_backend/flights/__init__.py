"""Flights: a drone's broadcast positions, cut where it was not heard for five minutes. Unverified."""
