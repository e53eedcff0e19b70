"""How a pad, a drone or a service gets its certificate without its key ever leaving it.

The machine makes a key and writes a request; whoever is in charge of the organisation's CA looks at it and admits it;
the machine takes the admission. Both files have nothing secret. What people compare is a code over each.
"""
