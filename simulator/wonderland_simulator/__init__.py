"""The world around everything else: flight, GNSS, radio channel, virtual UWB nodes, liars, recordings, the demo.

It sits *behind* the interfaces that real parts would have: UCI on a serial port, Remote ID frames on UDP, an autopilot
on UDP. No agent can tell.
"""
