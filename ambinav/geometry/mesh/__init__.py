"""Buildings as triangles: reading them, rays through Embree, the floor and what is free on it."""
