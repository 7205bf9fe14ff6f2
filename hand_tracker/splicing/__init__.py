"""A tracked hand on a body that another system captured: clocks, frames and skeletons joined."""
