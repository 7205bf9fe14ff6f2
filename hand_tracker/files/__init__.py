"""Read and write files: hands, layouts, URDF, tables of angles, recordings of any system."""
