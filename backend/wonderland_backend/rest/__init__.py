"""The REST interface: endpoints by domain, put together in `wonderland_backend.routes`."""
