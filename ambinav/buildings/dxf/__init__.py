"""Read DXF drawings: layers, lines and the floor that they enclose."""
