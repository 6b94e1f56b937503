"""From CAD models to exact patches: gmsh, the boundary representation, faces, volumes."""
