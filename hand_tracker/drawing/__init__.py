"""Figures, rendered meshes, animations and plots as image files; no display needed."""
