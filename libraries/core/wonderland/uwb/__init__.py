"""What pad and drone make of ultra-wideband radios (``wonderland_fira_uci``).

* ``layout``: which session configuration each node of a pad and a drone gets; ``blinks``: that of time stamps.
* ``link``: the encrypted, acknowledged messages that ride in the data frames (sans-I/O).
* ``reach``: which assurance nodes can bear by what they say that they can do.
* ``listen``, ``commands``: a board at the bench (``wonderland uwb``).
"""
