"""Numerics below the method: the compiler switch, vectors, quaternions."""
