"""A real place for the demo: from the OpenStreetMap extract that a package carries to one PMTiles archive.

``osm`` reads the extract, ``layers`` and ``shore`` make of it what a map shows, ``vector_tiles`` and ``archive`` write
it. ``fetch`` gets the package, ``commands`` ties all of it together. None of it runs on the way to the page.
"""
