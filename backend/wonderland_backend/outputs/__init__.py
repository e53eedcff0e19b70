"""What goes out to systems that police and integrators run: Cursor-on-Target, MQTT, live GeoJSON.

Everywhere the claimed position, the pad's estimate and the ledger's verdict are three things: three messages, three
switches. None replaces another.
"""
