"""Pictures: meshes, figures, animations and plots."""
