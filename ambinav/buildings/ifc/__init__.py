"""Read IFC buildings: storeys, parts, units, as floor plans and in space."""
