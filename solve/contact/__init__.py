"""Contact of two faces: search, projection, cells, mortar integrals, laws."""
