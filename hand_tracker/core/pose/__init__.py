"""The pose: angles without jumps, digits that touch, what is reported."""
