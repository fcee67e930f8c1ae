"""Read meshes, point clouds and OctoMaps: units, levelling, and the floor that is free."""
