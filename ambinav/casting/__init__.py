"""Ray casting: whole scans and single rays, in the plane, among prisms and in meshes."""
