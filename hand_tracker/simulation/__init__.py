"""Hands that move and markers that see them: motions and made recordings."""
