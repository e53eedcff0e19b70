"""The interface's description made whole: who may call what, an example for everything, and a page to read it."""
